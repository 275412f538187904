"""One body and one contact where hybrid codes break: gentle impacts, accumulating ones, odd units, coincidences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.one_contact import bouncing_cost, bouncing_slopes, go, make, oscillator_slopes

TOLERANCE = 1e-10
"""What `go` runs with."""
GRAVITY = 9.81


@pytest.mark.parametrize("speed", [1.0, 1e-1, 1e-2, 1e-3, 1e-4])
def test_gradient_error_of_a_gentle_impact_stays_below_a_thousand_tolerances_over_its_speed(speed):
    """The relative error of every gradient entry is at most 1e3 tolerance / speed, against the closed form."""
    v = np.sqrt(1 + speed**2)
    _, (by_scene, _, by_v), trajectory = go(make(stiffness=1.0, side=-1.0, offset=1.0, e=0.7), 0.0, v, 3.0)
    expected = oscillator_slopes(v, 1.0, 0.7, 3.0)
    found = [by_v, by_scene.offset[0], by_scene.e[0]]
    assert trajectory.status == hs.Status.successful
    assert_close(np.divide(found, expected), np.ones(3), 1e3 * TOLERANCE / speed)


@pytest.mark.parametrize("speed", [1e-5, 1e-6, 1e-8, 0.0])
def test_an_impact_too_gentle_for_the_tolerances_is_told(speed):
    """Where hit and miss differ by less than the tolerance, the status says grazing, and nothing is NaN."""
    value, gradient, trajectory = go(make(stiffness=1.0, side=-1.0, offset=1.0, e=0.7), 0.0, np.sqrt(1 + speed**2), 3.0)
    assert trajectory.status == hs.Status.grazing
    assert np.isfinite(value) and all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))


@pytest.mark.parametrize("e", [0.01, 0.1, 0.5, 0.8, 0.9])
def test_accumulating_impacts_end_in_rest_with_the_value_and_gradient_of_the_limit(e):
    """A ball comes to rest; cost and gradient are those of the infinite series of bounces."""
    value, (by_scene, by_q, _), trajectory = go(make(load=-GRAVITY, e=e), 1.0, 0.0, 12.0)
    expected = bouncing_slopes(1.0, GRAVITY, e)
    assert trajectory.status == hs.Status.successful and bool(trajectory.mode[0])
    assert_close(value, bouncing_cost(1.0, GRAVITY, e), 1e-12)
    assert_close(np.stack([by_q, -by_scene.load[0], by_scene.e[0]]), np.stack(expected), 1e-11)


@pytest.mark.parametrize("length, time", [(1e-6, 1e-6), (1e3, 3600.0)])
def test_units_do_not_matter(length, time):
    """A ball that bounces to rest costs the same in micrometres and microseconds, kilometres and hours."""
    expected, _, _ = go(make(load=-GRAVITY, offset=-0.5, e=0.8), 1.5, 0.0, 5.0)
    scene = make(load=-GRAVITY * time**2 / length, offset=-0.5 / length, e=0.8)
    _, _, trajectory = go(scene, 1.5 / length, 0.0, 5.0 / time)
    assert trajectory.status == hs.Status.successful
    assert_close(trajectory.cost * length**2 * time + trajectory.final.q[0] * length, expected, 1e-9)


class BesideAPost(hs.AbstractScene):
    """An oscillator of 60 rad/s that strikes a thin post at x = 0.9, coming from 0."""

    width: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -3600.0 * q

    def gap(self, t, q):
        return 1 - 2 * jnp.exp(-(((q - 0.9) / self.width) ** 2))

    def restitution(self):
        return jnp.ones(1)


@pytest.mark.parametrize("start", [0.0, 1e8, 1.7e9])
def test_a_thin_post_is_met_at_any_clock(start):
    """It is struck at a = 0.9 - width sqrt(log 2) from x = 0, and after each way round by -1. A second of 2023 is known
    to 0.24 us, in which the oscillator goes 1e-5."""
    scene, state = BesideAPost(jnp.array(1e-3)), hs.State([0.0], [60.0])
    events = hs.simulate(scene, state, t0=jnp.array(start), t1=jnp.array(start + 0.3)).events
    angle = np.arcsin(0.9 - 1e-3 * np.sqrt(np.log(2)))
    expected = (angle + (np.pi + 2 * angle) * np.arange(4)) / 60
    assert events.count == 4
    np.testing.assert_allclose(events.time[:4] - start, expected, atol=max(1e-6, 16 * np.spacing(start)))


class TowardsABlunt(hs.AbstractScene):
    """A body at speed 1 that comes to a bump so blunt that many steps are cut before one ends on it."""

    top: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return 0 * q

    def gap(self, t, q):
        return 1 - self.top * jnp.exp(-(((q - 5.0) / 1.24) ** 8))

    def restitution(self):
        return jnp.ones(1)


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.0, 1e8, 1.7e9])
def test_what_steps_are_cut_for_is_met_at_any_clock(start):
    """At 5 - 1.24 log(1.01)^(1/8). With each cut the resolution of time was relaxed, to 1.5 s at 1e8."""
    motion = hs.simulate(TowardsABlunt(jnp.array(1.01)), hs.State([0.0], [1.0]), t0=start, t1=start + 8.0)
    np.testing.assert_allclose(motion.events.before.q[0], 5 - 1.24 * np.log(1.01) ** 0.125, atol=1e-8)
    np.testing.assert_allclose(motion.final.q, 2 * motion.events.before.q[0] - 8.0, atol=1e-6)


@pytest.mark.parametrize("height, start", [(0.0, 1e3), (0.0, 1e9), (1e3, 0.0), (1e6, 0.0), (1e9, 0.0)])
def test_a_far_floor_and_a_late_start_change_nothing(height, start):
    """A ball dropped by one metre comes to rest wherever the floor is and whatever the clock shows."""
    _, _, trajectory = go(make(load=-GRAVITY, offset=-height), height + 1.0, 0.0, start + 3.0, start)
    assert trajectory.status == hs.Status.successful and bool(trajectory.mode[0])
    assert_close(trajectory.final.q, np.array([height]), 1e-15, scale=max(height, 1.0))


@pytest.mark.parametrize("gap", [-1e-17, 0.0, 1e-17, 1e-14, 1e-12, 1e-9])
@pytest.mark.parametrize("start", [0.0, 1.0])
def test_an_impact_at_the_very_start_happens_once(gap, start):
    """A body that starts on its guard, or within rounding of it, rebounds once: v+ = -e v- - g t."""
    _, _, trajectory = go(make(load=-GRAVITY), gap, -1.0, start + 0.05, start)
    assert trajectory.status == hs.Status.successful and trajectory.events.count == 1
    assert_close(trajectory.final.v, np.array([0.5 - GRAVITY * 0.05]), 1e-7, scale=1.0)


@pytest.mark.parametrize("shift", [-1e-9, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-9])
def test_an_impact_near_the_end_is_on_one_side_of_it(shift):
    """The motion ends just before or just after the impact, and never below the floor by more than 1e-12."""
    impact = np.sqrt(2 / GRAVITY)
    _, _, trajectory = go(make(load=-GRAVITY), 1.0, 0.0, impact + shift)
    assert trajectory.status == hs.Status.successful
    assert trajectory.final.q[0] > -1e-12
    happened = int(trajectory.events.count)
    assert happened == (shift > 0) or abs(shift) <= 1e-14
    assert_close(trajectory.final.v, np.array([[-1, 0.5][happened] * GRAVITY * impact]), 1e-7)


@pytest.mark.parametrize(
    "gap, speed", [(1e-17, 0.0), (1e-12, 0.0), (1e-8, 0.0), (0.0, 1e-12), (0.0, -1e-8), (0.0, 1e-4)]
)
def test_a_body_that_almost_rests_comes_to_rest(gap, speed):
    """Bounces of the size of rounding do not go on for ever."""
    _, _, trajectory = go(make(load=-GRAVITY, offset=-1.0), 1.0 + gap, speed, 1.0)
    assert trajectory.status == hs.Status.successful and bool(trajectory.mode[0])


@pytest.mark.filterwarnings("ignore:An `rtol` below")
@pytest.mark.parametrize("e", [0.5, 0.8, 0.9])
def test_single_precision_reaches_its_own_accuracy(e):
    """In float32 the ball misses no impact and rests; cost and gradient by e are right to 3e-6."""
    value, (by_scene, _, _), trajectory = go(make(load=-GRAVITY, e=e, dtype=jnp.float32), 1.0, 0.0, 12.0)
    assert value.dtype == jnp.float32
    assert trajectory.status == hs.Status.successful and bool(trajectory.mode[0])
    assert_close(value, bouncing_cost(1.0, GRAVITY, e), 3e-6)
    assert_close(by_scene.e[0], bouncing_slopes(1.0, GRAVITY, e)[2], 3e-6)
