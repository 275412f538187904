"""A motion may start on its own section: a guard that is zero there to rounding, and falling, fires at the start."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

TURN = 2 * np.pi


class Phase(hs.AbstractHybridSystem):
    """x' = speed; where sin(x + shift) falls through 0, x goes back by a turn, and so is on the section still."""

    speed: jax.Array
    shift: jax.Array

    def flow(self, t, x, mode):
        return self.speed

    def guards(self, t, x, mode):
        return jnp.sin(x + self.shift)[None]

    def transition(self, event, t, x, mode):
        return x - TURN, mode


class Rotation(hs.AbstractHybridSystem):
    """x'' = -w^2 x, seen from a frame that is turned round wherever x falls through 0; rounding is all that is left of
    the turn."""

    w: jax.Array

    def flow(self, t, x, mode):
        return jnp.stack([self.w * x[1], -self.w * x[0]])

    def guards(self, t, x, mode):
        return x[:1]

    def transition(self, event, t, x, mode):
        c, s = jnp.cos(TURN), jnp.sin(TURN)
        return jnp.stack([c * x[0] - s * x[1], s * x[0] + c * x[1]]), mode


@jax.jit
def times_of_phase(speed, shift, x0, t0=0.0):
    """Times of the events of a `Phase` since t0, their number, and the status."""
    solution = hs.solve(Phase(speed, shift), x0, t0=t0, t1=t0 + 20.0 / speed, max_events=8, throw=False)
    return solution.events.time - t0, solution.events.count, solution.status


@pytest.mark.parametrize(("speed", "t0"), [(1.0, 0.0), (1e-6, 0.0), (1e9, 0.0), (1.0, 1e6), (1e-6, 1e6)])
@pytest.mark.parametrize(("shift", "x0"), [(0.0, np.pi), (0.0, -np.pi), (np.pi / 2, np.pi / 2), (0.5, np.pi - 0.5)])
def test_the_first_event_comes_at_the_start_and_the_next_one_a_turn_later(shift, x0, speed, t0):
    """Whatever the sign of the rounding that the guard starts with, and that a turn leaves."""
    times, count, status = times_of_phase(speed, shift, x0, t0)
    assert status == hs.Status.successful and count == 4
    # At a late clock an event is placed to 1e-12 of what the clock shows, 1e-6 of 19: see `MOST_RELAXED`.
    assert_close(times[:4] * speed, np.arange(4) * TURN, 1e-7 if t0 else 1e-12)


def test_the_time_of_a_later_event_has_its_derivatives():
    """t = (pi - shift - x0 + 2 pi n) / speed."""
    third = lambda speed, shift, x0: times_of_phase(speed, shift, x0)[0][2]
    gradient = jax.grad(third, argnums=(0, 1, 2))(2.0, 0.0, np.pi)
    assert_close(gradient, (-2 * TURN / 4, -0.5, -0.5), 1e-9)


def test_a_section_of_an_oscillator_is_passed_once_a_turn():
    """Where the coordinate that the guard shows is exactly 0 at the start, the clock tells what rounding is."""
    solution = hs.solve(Rotation(jnp.array(3.0)), jnp.array([0.0, -1.0]), t0=1.0, t1=11.0, max_events=8)
    assert solution.events.count == 5
    assert_close(solution.events.time[:5], 1 + np.arange(5) * TURN / 3, 1e-8)  # the tolerance of the solve


class Stopped(hs.AbstractHybridSystem):
    """x' = -1 from 1; at 1/2 it is stopped at 0, the threshold of the other guard but for a small distance."""

    distance: jax.Array

    def flow(self, t, x, mode):
        return jnp.where(mode[0], 0.0, -1.0)

    def guards(self, t, x, mode):
        return jnp.where(mode, 1.0, x - jnp.stack([0.5, self.distance]))

    def transition(self, event, t, x, mode):
        return jnp.where(event == 0, 0.0, x), mode.at[event].set(True)


def test_a_guard_that_an_event_puts_on_0_has_not_fallen_unless_it_reaches_0_before():
    """As the page on hybrid systems says, with its remedy."""
    solve = jax.jit(lambda distance: hs.solve(Stopped(distance), 1.0, jnp.zeros(2, bool), t1=2.0).events)
    counts = [int(solve(jnp.array(distance)).count) for distance in (0.0, 1e-9)]
    assert counts == [1, 2]


class Rising(hs.AbstractHybridSystem):
    """x' = rate; one guard falls where x rises to 1, another where it falls to 0."""

    rate: jax.Array

    def flow(self, t, x, mode):
        return self.rate

    def guards(self, t, x, mode):
        return jnp.stack([1.0 - x, x])

    def transition(self, event, t, x, mode):
        return x, mode


def test_a_guard_that_is_below_0_from_the_start_on_is_told_when_the_motion_is_printed():
    """It waits until it rises. One that an event took below 0, or that has risen beside other events, is no news. One
    that rose, and nothing else happened, may have the wrong sign."""
    moved = jax.jit(lambda rate, x0: hs.solve(Rising(rate), x0, t1=3.0, max_events=4))
    told = lambda rate, x0: [line for line in str(moved(rate, x0)).splitlines() if "below 0" in line]
    assert told(1.0, -1.0) == []
    assert told(1.0, 0.5) == []
    assert told(0.1, -1.0) == ["guard 1 has been below 0 from the start: it waits until it rises"]
    rose = str(moved(0.4, -1.0)).splitlines()[2]
    assert rose == "guard 1 rose above 0, and an event is where a guard falls: is its sign right?"
    assert moved(1.0, 0.5).waiting.tolist() == [True, False]
