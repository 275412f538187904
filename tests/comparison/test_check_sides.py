"""Where other events happen from this very point on, a derivative of one side alone is told."""

import re
import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.check_motions import Call
from hybridsens.comparison.check_sides import kink_at, kinked, one_sided, other_side

HERE = 1.0


def motion(events, status=hs.Status.successful):
    """One with these events."""
    seen = types.SimpleNamespace(guard=np.array(events))
    return Call(None, None, jnp.array(0.0), jnp.array(1.0), seen, status, None, None, ())


def told(J, beyond=hs.Status.successful, place=HERE):
    """The verdict on a slope of 2, where another event comes from `place` on, and J is this function of p."""
    value = lambda vector: (J(vector[0]), (motion([0]) if vector[0] <= place else motion([1], beyond),))
    side = other_side(value, float(J(HERE)), (motion([0]),), np.array([HERE]), (0, 1.0))
    return one_sided(side, 2.0, 1e-5, 1e-8)


@pytest.mark.parametrize(
    ("J", "words"),
    [
        (lambda p: jnp.where(p > HERE, 2 * p + 1, 2 * p), "and J jumps by 1"),
        (lambda p: jnp.where(p > HERE, 5 * p - 3, 2 * p), "and the derivative is 5"),
        (lambda p: jnp.where(p > HERE, 2 * HERE, 2 * p), "and the derivative is 0"),
        (lambda p: jnp.where(p > HERE, 2 * HERE + (p - HERE) ** 0.5, 2 * p), "and J jumps by 3.1.e-05"),
    ],
)
def test_a_jump_and_another_slope_are_told(J, words):
    """All agreed, since differences keep to the side on which the events are the same."""
    assert re.fullmatch(f"one-sided: for the least change other events happen, {words}", told(J))


def test_what_is_the_same_on_both_sides_is_not():
    """As where two events at one instant do not act on each other; nor where no motion is beyond, or the place at which
    the events change is elsewhere."""
    smooth, jumps = lambda p: p**2, lambda p: jnp.where(p > HERE, 7.0, 2 * p)
    assert told(smooth) == ""
    assert told(jumps, beyond=hs.Status.bad_restitution) == ""
    assert told(jumps, place=HERE + 1e-6) == ""


@pytest.mark.parametrize(
    ("J", "slopes"),
    [
        (lambda p: max(p - HERE, 0.0), (0.0, 1.0)),
        (lambda p: 7.0 + 3 * p + abs(p - HERE), (2.0, 4.0)),
        # Where the events are others at the larger widths.
        (lambda p: abs(p - HERE) if abs(p - HERE) < 3e-4 else np.nan, (-1.0, 1.0)),
    ],
)
def test_a_kink_at_the_point_is_told(J, slopes):
    """JAX gives the mean of both slopes there, and so do central differences."""
    found = kink_at(lambda vector: J(vector[0]), np.array([HERE]), (0, 1.0), 1e-4)
    np.testing.assert_allclose(found, slopes, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    "J",
    [
        lambda p: 1e3 * (p - HERE) ** 4 + p**2,
        lambda p: np.sin(300 * p),
        lambda p: np.tanh((p - HERE) / 1e-3),
        lambda p: abs(p - HERE) ** 1.5,
        lambda p: max(p - HERE - 1e-3, 0.0),
        lambda p: p + 1e-10 * np.sin(1e9 * p),  # noise
        lambda p: np.sqrt(p - HERE) if p >= HERE else np.nan,
        lambda p: p if p <= HERE else np.nan,
    ],
)
def test_what_has_a_derivative_has_no_kink(J):
    """Nor has what is curved, steep, noisy or kinked elsewhere."""
    assert kink_at(lambda vector: J(vector[0]), np.array([HERE]), (0, 1.0), 1e-4) is None


def test_a_slope_that_a_kink_does_not_explain_stays_in_doubt():
    """One of a side, or between both, is explained."""
    for slope in (-1.0, 0.0, 1.0):
        assert "slope -1 on its left and 1 on its right" in kinked((-1.0, 1.0), (0.0, slope), 1e-5)
    assert kinked((-1.0, 1.0), (0.0, 1.1), 1e-5) == "" == kinked(None, (0.0, 0.0), 1e-5)


@pytest.mark.slow
def test_a_kink_within_rounding_of_the_point_is_told():
    """As at a minimum of absolute deviations: there each method may have the slope of another side."""
    ball = hs.scenes.BouncingBall(velocity=0.3)
    end = lambda scene, simulate: simulate(scene, scene.initial_state(), t1=0.2).final.q[0]
    there = 1.0 + 0.3 * 0.2 - 9.81 * 0.2**2 / 2
    for away in (0.0, 1e-13, -1e-13):
        cost = lambda scene, simulate, away=away: jnp.abs(end(scene, simulate) - (there + away))
        check = hs.check_gradient(ball, cost, parameters="velocity", progress=False)
        assert not check.ok and [cause.kind for cause in check.causes] == ["kink"]


@pytest.mark.slow
@pytest.mark.parametrize(("value", "ok"), [(0.0, False), (0.3, True)])
def test_a_kink_of_the_cost_is_told(value, ok):
    """JAX's derivative of max(u, 0) at 0 is 1/2; one of the sides has 0 and the other 1."""
    ball = hs.scenes.BouncingBall(velocity=value)
    cost = lambda scene, simulate: (
        jnp.maximum(scene.velocity, 0.0) + simulate(scene, scene.initial_state(), t1=0.2).final.v[0]
    )
    check = hs.check_gradient(ball, cost, parameters="velocity", progress=False)
    assert check.ok is ok
    assert [cause.kind for cause in check.causes] == ([] if ok else ["kink"])
    assert ok or "slope 1 on its left and 2 on its right" in check.parameters[0].verdict


class Switched(hs.AbstractHybridSystem):
    """x' = -k x from the first time until the second."""

    k: jax.Array
    at: jax.Array

    def flow(self, t, x, mode):
        return jnp.where(mode, -self.k * x, 0.0 * x)

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return self.at

    def transition(self, event, t, x, mode):
        return x, ~mode


@pytest.mark.slow
@pytest.mark.parametrize(("last", "ok"), [(2.0, False), (2.3, True)])
def test_a_scheduled_event_at_the_end_is_told(last, ok):
    """By the time of it x(2) = exp(-k (at_1 - at_0)) has the slope -k x before the end, and 0 after it."""
    cost = lambda system, solve: solve(system, 1.0, False, t1=2.0).final
    check = hs.check_gradient(Switched(jnp.array(0.5), jnp.array([1.0, last])), cost, progress=False)
    assert check.ok is ok
    assert [cause.kind for cause in check.causes] == ([] if ok else ["event at a data time"])
    assert [entry.parameter for entry in check.parameters if entry.verdict] == ([] if ok else ["at[1]"])
