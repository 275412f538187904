"""Studies and transformations take a scene with switches, or say why they do not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.switched_scenes import Cart, cart_rates, constant_force

pytestmark = pytest.mark.slow
NUMBERS = (2.0, 0.3, 0.7, 1.0, 0.8)
CART = Cart(*map(jnp.asarray, NUMBERS))
START = hs.State([0.1], [1.0])
END = 1.1
"""After a switch, an impact and a switch."""


def cost(scene, simulate):
    """Where the cart ends."""
    return simulate(scene, START, True, t1=END).final.q[0]


def exact(*numbers):
    """The same in 30 digits."""
    p = [mp.mpf(number) for number in numbers]
    return constant_force(cart_rates, 2, p, mp.mpf("0.1"), mp.mpf(1), True, mp.mpf(END))[1][0]


def slopes():
    """Its derivatives by the five parameters."""
    at = [mp.mpf(number) for number in NUMBERS]
    return np.array([mp.diff(exact, at, tuple(int(i == k) for i in range(5))) for k in range(5)], float)


def test_the_gradient_is_checked():
    """Adjoint, forward sensitivities and differences agree, and nothing is in doubt."""
    check = hs.check_gradient(CART, cost, max_events=8)
    assert_close([entry.adjoint for entry in check.parameters], slopes(), 1e-8)
    assert not any(entry.verdict for entry in check.parameters) and check.events == () and check.causes == ()


def test_naive_methods_say_that_they_know_impacts_alone():
    """Ours has a row with its error, the others one with the reason."""
    table = hs.compare(CART, cost, adjoints=(hs.Replay(),), max_events=8, steps=100, progress=False)
    assert table["Replay"].gradient_error < 1e-8
    naive = [row for row in table.rows if row.method.startswith("autodiff")]
    assert len(naive) == 5 and all("the scene has switches" in row.failure for row in naive)


def test_a_sweep_and_a_batch_of_modes_have_the_values_of_single_motions():
    """Over thresholds by `sweep`, over modes by `jax.vmap`."""
    far = np.array([0.6, 0.65, 0.7])

    def swept_cost(scene):
        motion = hs.simulate(scene, START, True, t1=END, max_events=8, throw=False)
        return motion.final.q[0], motion

    swept = hs.sweep(swept_cost, hs.grid(CART, {"far": far}), events=3, progress=False)
    assert swept["event_kind"].values.tolist() == [[3, 0, -1], [3, 0, 3], [3, 0, 3]]
    found = [float(exact(*NUMBERS[:2], one, *NUMBERS[3:])) for one in far]
    assert_close(np.ravel(swept["J"]), np.array(found), 1e-8)
    end = jax.vmap(jax.grad(lambda v, mode: hs.simulate(CART, hs.State([0.5], v[None]), mode, t1=0.2).final.q[0]))
    assert_close(end(jnp.array([0.1, 0.1]), jnp.array([True, False])), np.array([0.2, 0.2]), 1e-9)


def test_parameters_are_fitted_from_samples():
    """Threshold and restitution from the exact motion of another cart."""
    ts = jnp.linspace(0.0, END, 12)
    seen = hs.simulate(CART, START, True, t1=END, ts=ts)
    guess = Cart(CART.push, CART.near, jnp.array(0.66), CART.width, jnp.array(0.85))
    data = {"t": np.asarray(ts), "q0": np.asarray(seen.q[:, 0])}
    fitted = hs.fit(guess, data, parameters=["far", "e"], state=START, mode=True, max_events=8)
    assert_close([fitted.scene.far, fitted.scene.e], np.array([0.7, 0.8]), 1e-6)


def test_growth_costate_and_second_derivatives_go_through_switches():
    """The Lyapunov matrix has the determinant e^2; the costate of a sample is the gradient of what follows in its mode;
    the Hessian is that of 30 digits."""
    grown = hs.lyapunov(CART, START, True, t1=END, max_events=8)
    assert_close(jnp.linalg.det(grown.matrix), np.array(0.64), 1e-8)
    ts = jnp.array([0.2, 0.5])  # before and after the first switch
    motion = hs.simulate(CART, START, True, t1=END, ts=ts, max_events=8)
    costate = motion.from_each_sample(lambda motion: motion.final.q[0])
    rest = lambda state, mode: hs.simulate(CART, state, mode, t0=0.5, t1=END).final.q[0]
    later = jax.grad(rest)(hs.State(motion.q[1], motion.v[1]), False)
    assert_close(jnp.append(costate.q[1], costate.v[1]), jnp.append(later.q, later.v), 1e-8)

    def end(far):
        return cost(Cart(*NUMBERS[:2], far, *NUMBERS[3:]), hs.simulate)

    bend = mp.diff(lambda far: exact(*NUMBERS[:2], far, *NUMBERS[3:]), mp.mpf("0.7"), 2)
    assert_close(jax.hessian(end)(jnp.array(0.7)), np.array(float(bend)), 1e-7)


def test_parameters_of_a_coarser_type_keep_their_own():
    """Leaves in single precision under a state in double precision: their gradients come in single precision."""
    coarse = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), CART)
    made = jax.grad(lambda scene: cost(scene, hs.simulate))(coarse)
    assert made.far.dtype == jnp.float32
    assert_close(np.array(jax.tree.leaves(made)), slopes(), 1e-5)
