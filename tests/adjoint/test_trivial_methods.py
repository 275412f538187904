"""Trivial motions by the other gradient methods, to second order, without control; and a motion that is not trivial."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.scenes import ElasticStop
from tests.problems import trivial_motions as motions
from tests.problems.trivial_cases import (
    ADJOINTS,
    CASES,
    FORWARD,
    REPLAY,
    STOP,
    assert_right,
    point_of,
    springs_at,
    true_gradient_of,
)

OTHERS = [method for method in ADJOINTS if method not in (REPLAY, FORWARD)]


@pytest.mark.slow
@pytest.mark.parametrize("method", OTHERS)
@pytest.mark.parametrize("case", [case for case in CASES if case[1] is motions.springs], ids=lambda case: case[0])
def test_every_method_has_it_right(case, method):
    """The other three, on the motions without impacts."""
    assert_right(case, method)


@pytest.mark.parametrize("name", ["oscillator at rest", "its drive, at 0", "forced, a = 0", "the fast one's drive"])
def test_without_control_the_number_is_wrong(name):
    """So that the tests above can fail: `rtol=inf` differentiates the few steps that the motion takes."""
    case = next(case for case in CASES if case[0] == name)
    point = point_of(case[2])
    found, truth = _uncontrolled(case[1])(point), true_gradient_of(case[1])(point)
    assert any(float(jnp.max(jnp.abs(found[by] - truth[by]))) > 0.5 for by in case[3].split())


@functools.cache
def _uncontrolled(cost):
    return jax.jit(jax.grad(lambda p: cost(p, 1e-8, hs.Replay(rtol=math.inf))))


@pytest.mark.slow
@pytest.mark.parametrize("forward", [False, True], ids=[REPLAY, FORWARD])
def test_second_derivatives_at_rest(forward):
    """q(T)^2 / 2 at rest: its gradient is 0, its Hessian is the outer product of the derivatives of q(T)."""
    base = point_of(springs_at(20, **STOP))
    names = ("q", "v", "a")

    def half_square(q_of, s):
        p = base | {name: jnp.stack([s[i], jnp.zeros(())]) for i, name in enumerate(names)}
        return q_of(p) ** 2 / 2

    truth = jax.hessian(functools.partial(half_square, motions.springs_truth))(jnp.zeros(3))
    adjoint = hs.ForwardSensitivities() if forward else hs.Replay()
    cost = functools.partial(half_square, lambda p: motions.springs(p, 1e-8, adjoint))
    hessian = jax.jit(jax.jacfwd((jax.jacfwd if forward else jax.grad)(cost)))(jnp.zeros(3))
    np.testing.assert_allclose(hessian, truth, rtol=0, atol=1e-6 * float(jnp.max(jnp.abs(truth))))


@pytest.mark.slow
def test_control_leaves_a_lively_motion_as_it_is():
    """Its steps resolve the derivative already: the value is the same to the last bit, the gradient to 1e-9."""
    scene = ElasticStop()
    start = scene.initial_state()

    def solve(rtol):
        def cost(scene, v):
            state = hs.State(start.q, v)
            return hs.simulate(scene, state, t1=scene.t1, adjoint=hs.Replay(rtol=rtol)).final.q[0]

        return jax.jit(jax.value_and_grad(cost, argnums=(0, 1)))(scene, start.v)

    (value, gradient), (uncontrolled, plain) = solve(None), solve(math.inf)
    assert value == uncontrolled
    flat = lambda tree: np.array([float(jnp.squeeze(leaf)) for leaf in jax.tree.leaves(tree)])
    assert np.max(np.abs(flat(gradient) - flat(plain))) <= 1e-9 * np.max(np.abs(flat(plain)))


@pytest.mark.parametrize(
    "method",
    [hs.Replay(), pytest.param(hs.ForwardSensitivities(), marks=pytest.mark.slow)],
    ids=["reverse", "forward"],
)
def test_a_derivative_that_runs_out_of_steps_is_raised(method):
    """The motion takes a few steps, its derivative over a thousand seconds more than 4 x 16: by state and parameter."""

    def final(p):
        at = hs.State(jnp.zeros(1), p[:1])
        scene = ElasticStop(amplitude=p[1])
        return hs.simulate(scene, at, t1=1000.0, max_steps=16, adjoint=method).final.q[0]

    derivative = jax.jacfwd if isinstance(method, hs.ForwardSensitivities) else jax.grad
    with pytest.raises(hs.SimulationError, match="The derivative of the motion is not finished"):
        derivative(final)(jnp.zeros(2))
