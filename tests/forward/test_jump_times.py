"""Declared times of kinks and jumps: steps land on them, and gradients reach them."""

import functools
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import hybridsens as hs

HORIZON = 2.0
TAU = jnp.array([0.7, 1.3])
HEIGHTS = jnp.array([-2.0, 3.0])
REST = hs.State([0.0], [0.0])


class Switched(hs.AbstractScene):
    """q'' = 1 and more from each switching time on; whether the new force holds at the very instant is a choice."""

    tau: Array
    heights: Array
    at_once: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        on = jnp.where(self.at_once > 0, t >= self.tau, t > self.tau)
        return 1 + jnp.sum(jnp.where(on, self.heights, 0))[None]

    def gap(self, t, q):
        return q + 1e3

    def restitution(self):
        return jnp.array([0.5])

    def jump_times(self):
        return self.tau


def switched(tau, heights=HEIGHTS, at_once=1.0, **settings):
    return hs.simulate(Switched(tau, heights, jnp.asarray(at_once)), REST, t1=HORIZON, **settings)


def place(tau, heights=HEIGHTS, at_once=1.0, **settings):
    """q at the end."""
    return switched(tau, heights, at_once, **settings).final.q[0]


def closed_form(tau, heights=HEIGHTS, t=HORIZON):
    """The same, of switching times inside of the horizon or not."""
    since = t - jnp.clip(tau, 0, t)
    return t**2 / 2 + jnp.sum(heights * since**2) / 2


_SLOPES = jax.jit(jax.vmap(jax.value_and_grad(place, argnums=(0, 1)), in_axes=(0, None, 0)))
LANES = 7


def batched_slopes(tau, at_once):
    """Values and gradients of up to seven pairs of switching times, by one program: those given fill the batch."""
    filled = lambda given: jnp.resize(given, (LANES, *given.shape[1:]))
    return jax.tree.map(lambda leaf: leaf[: len(tau)], _SLOPES(filled(tau), HEIGHTS, filled(at_once)))


@pytest.mark.slow
def test_switching_times_of_bang_bang_control():
    """Value and gradient against the closed form, whichever force holds at the very instant."""
    (value, (by_tau, by_heights)) = batched_slopes(jnp.stack([TAU, TAU]), jnp.array([1.0, 0.0]))
    np.testing.assert_allclose(value, closed_form(TAU), rtol=1e-12)
    truth = jax.grad(closed_form, argnums=(0, 1))(TAU, HEIGHTS)
    np.testing.assert_allclose(by_tau, np.stack([truth[0]] * 2), rtol=1e-8)
    np.testing.assert_allclose(by_heights, np.stack([truth[1]] * 2), rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["forward", "recompute", "Hessian"])
def test_other_ways_to_differentiate_agree(method):
    """Forward mode, recomputed segments, and forward over reverse."""
    truth = jax.grad(closed_form)(TAU)
    if method == "forward":
        found = jax.jacfwd(lambda tau: place(tau, adjoint=hs.ForwardSensitivities()))(TAU)
    elif method == "recompute":
        found = jax.grad(lambda tau: place(tau, adjoint=hs.Replay(recompute=True)))(TAU)
    else:
        found, truth = jax.jit(jax.jacfwd(jax.grad(place)))(TAU), jax.hessian(closed_form)(TAU)
    np.testing.assert_allclose(found, truth, rtol=1e-8, atol=1e-8)


@pytest.mark.slow
def test_times_in_any_order_and_outside_of_the_horizon():
    """Those before the start or behind the end move nothing; one at the end has no effect yet. Two that coincide count
    as one: their derivatives are right together."""
    tau = jnp.array([[1.3, 0.7], [-1.0, 0.7], [0.7, 2.5], [-3.0, -1.0], [5.0, 4.0], [0.7, 2.0], [0.7, 0.7]])
    value, (by_tau, _) = batched_slopes(tau, jnp.ones(7))
    of_all = jax.vmap(jax.value_and_grad(closed_form))(tau)
    np.testing.assert_allclose(value, of_all[0], rtol=1e-12)
    np.testing.assert_allclose(by_tau[:6], of_all[1].at[5, 1].set(0)[:6], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(by_tau[6].sum(), of_all[1][6].sum(), rtol=1e-8)


@pytest.mark.slow
def test_a_time_at_the_start_is_a_corner():
    """Later it moves the switch, earlier it does not: the gradient is one of both slopes."""
    value, (by_tau, _) = batched_slopes(jnp.array([[0.0, 1.3]]), jnp.ones(1))
    np.testing.assert_allclose(value[0], closed_form(jnp.array([0.0, 1.3])), rtol=1e-12)
    np.testing.assert_allclose(by_tau[0, 1], -3 * 0.7, rtol=1e-8)
    assert any(by_tau[0, 0] == pytest.approx(slope, abs=1e-8) for slope in (0, 2 * HORIZON))


def between(t0, t1, tau, at_once, adjoint=None):
    """Velocities at the end and at samples at both ends, less t0, of a motion that starts at rest."""
    scene = Switched(tau[None], jnp.array([2.0]), at_once)
    motion = hs.simulate(scene, REST, t0=t0, t1=t1, ts=jnp.stack([t0, t1]), max_steps=64, adjoint=adjoint)
    return jnp.concatenate([motion.final.v, motion.v[:, 0] - t0])


summed = lambda *given: (jnp.sum(found := between(*given)), found)
slopes_of_sum = jax.jit(jax.grad(summed, argnums=(0, 1, 2), has_aux=True))
forward = functools.partial(between, adjoint=hs.ForwardSensitivities())
rates_along = jax.jit(lambda given, way: jax.jvp(forward, given, way)[1])


@pytest.mark.slow
@pytest.mark.parametrize("at_once", [1.0, 0.0], ids=["at once", "after it"])
@pytest.mark.parametrize(("t0", "t1", "rate"), [(0.5, 1.5, 1.0), (1.5, 3.0, -3.0)], ids=["at t1", "at t0"])
def test_a_time_at_an_end_of_the_horizon_moves_with_it(t0, t1, rate, at_once):
    """v = (t1 - t0) + 2 (t1 - tau): the derivative by both at once has one value, whichever side is taken at tau. At t1
    it was -3; and a last step looked beyond the jump, or a first one of a force that holds from just after it."""
    expected = t1 - t0 if rate > 0 else 3 * (t1 - t0)
    given = tuple(map(jnp.array, (t0, t1, 1.5, at_once)))
    of_both = np.array([rate, 0.0, rate]) - (0 if rate > 0 else np.array([0, 1, 1]))  # samples are less t0
    (by_t0, by_t1, by_tau), found = slopes_of_sum(*given)
    np.testing.assert_allclose(found, [expected, -t0, expected - t0], rtol=1e-12)
    np.testing.assert_allclose((by_t1 if rate > 0 else by_t0) + by_tau, of_both.sum(), rtol=1e-10)
    way = tuple(map(jnp.array, (0.0, 1.0, 1.0, 0.0) if rate > 0 else (1.0, 0.0, 1.0, 0.0)))
    np.testing.assert_allclose(rates_along(given, way), of_both, rtol=1e-10, atol=1e-10)


@pytest.mark.slow
def test_samples_at_the_very_times():
    """A sample that moves with a switching time: its own rate, and what the switch does."""
    both = lambda tau: switched(tau, ts=tau).q[:, 0].sum()
    exact = lambda tau: tau[0] ** 2 / 2 + tau[1] ** 2 / 2 - (tau[1] - tau[0]) ** 2
    value, slope = jax.value_and_grad(both)(TAU)
    assert value == pytest.approx(float(exact(TAU)), rel=1e-12)
    np.testing.assert_allclose(slope, jax.grad(exact)(TAU), rtol=1e-8)


@pytest.mark.slow
def test_no_times_at_all():
    """An empty array declares that there are none."""
    empty = jnp.zeros(0)
    assert place(empty, empty) == pytest.approx(HORIZON**2 / 2, rel=1e-12)


@pytest.mark.slow
def test_three_hundred_times():
    """A force in 301 pieces of random height."""
    random = np.random.default_rng(0)
    tau, heights = jnp.array(random.uniform(0, HORIZON, 300)), jnp.array(random.normal(size=300))
    value, (by_tau, by_heights) = jax.value_and_grad(place, argnums=(0, 1))(tau, heights)
    truth = jax.grad(closed_form, argnums=(0, 1))(tau, heights)
    assert value == pytest.approx(float(closed_form(tau, heights)), rel=1e-10)
    np.testing.assert_allclose(by_tau, truth[0], atol=1e-8 * float(jnp.max(jnp.abs(truth[0]))))
    np.testing.assert_allclose(by_heights, truth[1], atol=1e-8 * float(jnp.max(jnp.abs(truth[1]))))


@pytest.mark.slow
def test_a_running_cost_that_jumps():
    """d/dtau of the integral of q up to tau is q(tau)."""
    until = lambda scene, t, q, v: jnp.where(t < scene.tau[1], q[0], 0)
    tau = jnp.array([3.0, 1.3])
    cost, slope = jax.value_and_grad(lambda tau: switched(tau, running_cost=until).cost)(tau)
    assert cost == pytest.approx(1.3**3 / 6, rel=1e-8)
    np.testing.assert_allclose(slope, [0, 1.3**2 / 2], rtol=1e-8, atol=1e-12)


class Lifted(Switched):
    """A body on a floor, pressed until tau and lifted from then on."""

    def force(self, t, q, v):
        return jnp.where(t < self.tau, -1.0, self.heights)

    def gap(self, t, q):
        return q


def test_a_jump_that_lets_a_held_contact_go():
    """The body rises from tau on; no event is listed, and room for a single one is enough."""

    def cost(tau, height):
        scene = Lifted(tau[None], height[None], jnp.ones(()))
        motion = hs.simulate(scene, REST, t1=HORIZON, max_events=1)
        return motion.final.q[0], motion

    slope = jax.value_and_grad(cost, argnums=(0, 1), has_aux=True)
    (value, motion), (by_tau, by_height) = slope(jnp.array(0.6), jnp.array(3.0))
    assert motion.events.count == 0 and motion.events.contact[0] == -1 and not motion.mode[0]
    assert value == pytest.approx(1.5 * 1.4**2, rel=1e-9)
    assert by_tau == pytest.approx(-3 * 1.4, rel=1e-8) and by_height == pytest.approx(1.4**2 / 2, rel=1e-8)


class Pulse(Switched):
    """A pulse of a hundredth of a second in free flight."""

    def force(self, t, q, v):
        return 100 * jnp.exp(-(((t - self.tau) / 0.01) ** 2))

    def jump_times(self):
        return self.tau + jnp.array([-0.03, 0.0, 0.03])


@pytest.mark.slow
def test_a_declared_pulse_is_found():
    """Free flight steps over it; declared times lead the steps there."""

    def cost(tau):
        scene = Pulse(tau[None], jnp.zeros(1), jnp.ones(()))
        final = hs.simulate(scene, hs.State([1.0], [0.1]), t1=10.0).final
        return final.v[0] + final.q[0], final

    kick = np.sqrt(np.pi)
    (_, final), slope = jax.value_and_grad(cost, has_aux=True)(jnp.array(5.3))
    assert final.v[0] == pytest.approx(0.1 + kick, rel=1e-7)
    assert final.q[0] == pytest.approx(2 + kick * 4.7, rel=1e-7)
    # What a pulse adds to the gradient by its time is a rise and a fall a hundred times larger than their sum.
    assert slope == pytest.approx(-kick, rel=1e-5)


class Undeclared(Switched):
    """The switched force by someone who says nothing."""

    def jump_times(self):
        return None


@pytest.mark.slow
def test_an_undeclared_time_warns_and_a_declared_one_does_not():
    """And `jump_ts` declares it as a method of the scene does, to the last bit."""
    scene = Undeclared(TAU, HEIGHTS, jnp.ones(()))
    with pytest.warns(hs.DiscontinuityWarning, match="jump_ts"):
        hs.simulate(scene, REST, t1=HORIZON)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        declared = hs.simulate(scene, REST, t1=HORIZON, jump_ts=TAU)
        assert declared.final.q[0] == place(TAU)
