"""Gaps, rates and forces that stop being numbers on the way: the motion ends there, with a status."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

HIGH = 10.0


class Breaks(hs.AbstractScene):
    """A ball over a floor at 0 whose gap and force take the value `wrong` below heights of their own."""

    known_discontinuities = True

    wrong: jax.Array
    gap_below: jax.Array
    rate_below: jax.Array
    force_below: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.where(q < self.force_below, self.wrong, -10.0)

    def gap(self, t, q):
        # The root of 0 has the value 0 and no derivative.
        q = q + jnp.where(q < self.rate_below, jnp.sqrt(0 * q), 0)
        return jnp.where(q < self.gap_below, self.wrong, q)

    def restitution(self):
        return jnp.full(1, 0.5)


@eqx.filter_jit
def fall(wrong=0.0, gap_below=-HIGH, rate_below=-HIGH, force_below=-HIGH):
    """From rest at 1 for a second."""
    scene = Breaks(*(jnp.asarray(number, float) for number in (wrong, gap_below, rate_below, force_below)))
    return hs.simulate(scene, hs.State(jnp.ones(1), jnp.zeros(1)), t1=1.0, max_steps=400, throw=False)


def run(**changed):
    return fall(**{name: jnp.asarray(value, float) for name, value in changed.items()})


def test_what_does_not_break_bounces():
    """What is changed below is what is wrong there."""
    motion = run(wrong=np.nan)
    assert motion.status == hs.Status.successful and motion.events.count == 2


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("which", ["gap_below", "force_below"])
@pytest.mark.parametrize("height", [0.3, 1e-9])
def test_a_motion_ends_where_it_stops_being_a_number(which, wrong, height):
    """A gap or a force that is none from some height on: no fall through the floor, no endless loop, the status says
    so, and the last state is the last good one."""
    motion = run(wrong=wrong, **{which: height})
    assert motion.status == hs.Status.non_finite
    assert motion.steps.accepted + motion.steps.rejected < 400
    assert_close(motion.final.q, np.array([height]), 1e-9, scale=1.0)


@pytest.mark.slow
def test_a_gap_without_a_rate_cannot_begin():
    """The value is right and its derivative is none: that is not called a penetration."""
    motion = run(rate_below=HIGH)
    assert motion.status == hs.Status.non_finite and motion.events.count == 0


@pytest.mark.parametrize("height", [0.3, 1e-3])
def test_a_gap_that_loses_its_rate_ends_the_motion(height):
    """From some height on the gap has no derivative, as `jnp.where` leaves it easily: no fall through the floor."""
    motion = run(rate_below=height)
    assert motion.status == hs.Status.non_finite
    assert_close(motion.final.q, np.array([height]), 1e-9, scale=1.0)


class Reciprocal(hs.AbstractHybridSystem):
    """x' = 1 from 0 on; at x = 1/2 the guard 1 / x - 2 falls, and x goes back to where it is infinite."""

    def flow(self, t, x, mode):
        return jnp.ones_like(x)

    def guards(self, t, x, mode):
        return (1 / x - 2)[None]

    def transition(self, event, t, x, mode):
        return jnp.zeros_like(x), mode


@pytest.mark.parametrize(("start", "times"), [(0.0, []), (0.25, [0.25])])
def test_a_guard_that_begins_at_infinity_ends_the_motion(start, times):
    """At the start, and after an event: nothing tells how far it is from its zero."""
    solution = hs.solve(Reciprocal(), start, t1=2.0, max_events=8, throw=False)
    assert solution.status == hs.Status.non_finite
    assert int(solution.events.count) == len(times)
    np.testing.assert_allclose(solution.events.time[: len(times)], times, rtol=1e-12)
