"""Derivatives by the beginning of a motion, where an event comes at once: both ways, against closed forms."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall
from tests.problems.hybrid_systems import Dosed

METHODS = [
    hs.Replay(),
    pytest.param(hs.Replay(recompute=True), marks=pytest.mark.slow),
    pytest.param(hs.ContinuousCostate(), marks=pytest.mark.slow),
    hs.ForwardSensitivities(),
]


def slope(cost, t0, adjoint):
    """d cost / d t0, forward where the method goes forward."""
    way = jax.jacfwd if adjoint.forward_mode else jax.jacrev
    return way(lambda t0: cost(t0, adjoint))(t0)


@pytest.mark.parametrize("adjoint", METHODS, ids=lambda method: type(method).__name__)
def test_of_a_motion_that_begins_with_an_impact(adjoint):
    """u = e |v| at t0: q(t1) = u (t1 - t0) - g (t1 - t0)^2 / 2; the impact is at t0, with v before it and u after."""
    ball, v, t1 = RestlessBall(jnp.array(9.0), jnp.array(0.6)), -4.0, 0.6

    def cost(t0, adjoint):
        motion = hs.simulate(ball, hs.State([0.0], [v]), t0=t0, t1=t1, max_events=4, adjoint=adjoint)
        events = motion.events
        return jnp.stack(
            [motion.final.q[0], events.time[0], events.before.v[0, 0], events.after.v[0, 0], events.closing_speed[0]]
        )

    t0 = jnp.array(0.3)
    fall = -(0.6 * 4.0) + 9.0 * (t1 - t0)
    assert_close(slope(cost, t0, adjoint), jnp.array([fall, 1.0, 0.0, 0.0, 0.0]), 1e-7)


@pytest.mark.parametrize("adjoint", METHODS, ids=lambda method: type(method).__name__)
def test_of_a_system_whose_known_event_comes_at_the_start(adjoint):
    """The dose stays where t0 was: x falls from 1 before it, by k dt0 less where the motion begins later."""

    def cost(t0, adjoint):
        system = Dosed(*jnp.array([0.3, 0.2, 2.0]))
        return hs.solve(system, 1.0, t0=t0, t1=1.0, rtol=1e-10, atol=1e-10, max_events=4, adjoint=adjoint).final

    def exact(t0):
        before = 1 / (1 + 0.3 * (0.2 - t0))
        return 1 / (1 / (before + 2.0) + 0.3 * 0.8)

    t0 = jnp.array(0.2)
    assert_close(slope(cost, t0, adjoint), jax.grad(exact)(t0), 1e-7)
