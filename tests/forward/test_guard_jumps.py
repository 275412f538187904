"""A guard that jumps below zero instead of falling: told of, and right where another event comes at that place."""

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close

PLACE = jnp.array(0.7)


class Faster(hs.AbstractHybridSystem):
    """x' = 1, and 3 from x = place on; `guards` are "jumps", which knows the place by a comparison, and "falls"."""

    place: jax.Array
    written: tuple[str, ...] = eqx.field(static=True)

    def flow(self, t, x, mode):
        return jnp.where(mode == 1, 3.0, 1.0)[None]

    def guards(self, t, x, mode):
        jumps = jnp.where(x[0] > self.place, -1 - 0.1 * x[0], 1.0) + 10.0 * mode
        return jnp.stack([jumps if name == "jumps" else self.place - x[0] for name in self.written])

    def transition(self, event, t, x, mode):
        return x, jnp.where(event == self.written.index("jumps"), 1, mode)


class Harmless(Faster):
    known_discontinuities = True


def moved(kind, place, *written, **given):
    return hs.solve(kind(place, written), jnp.zeros(1), jnp.array(0), t1=2.0, max_events=4, **given)


@pytest.mark.filterwarnings("ignore:`guards` must be smooth")
def test_one_that_jumps_is_told():
    """The motion is right; whoever says that it does no harm is told nothing."""
    with pytest.raises(hs.SimulationError, match="guard jumps below zero"):
        moved(Faster, PLACE, "jumps")
    motion = moved(Faster, PLACE, "jumps", throw=False)
    assert motion.status == hs.Status.guard_jumps
    assert_close(motion.doubt_time, PLACE, 1e-12)
    harmless = moved(Harmless, PLACE, "jumps")
    assert harmless.status == hs.Status.successful and jnp.isnan(harmless.doubt_time)
    assert_close(motion.final, jnp.array([4.6]), 1e-12)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`guards` must be smooth")
@pytest.mark.parametrize("written", [("falls", "jumps"), ("jumps", "falls")])
def test_it_moves_with_an_event_at_that_place(written):
    """d x(2) / d place = 1 - 3, by both modes, whichever guard is written first."""
    assert moved(Faster, PLACE, *written).status == hs.Status.successful
    end = lambda place, method: moved(Faster, place, *written, adjoint=method).final[0]
    assert_close(jax.grad(end)(PLACE, hs.Replay()), -2.0, 1e-12)
    assert_close(jax.jacfwd(end)(PLACE, hs.ForwardSensitivities()), -2.0, 1e-12)


class Waiting(Faster):
    """The other guard lies below 0 and rises at the place, which is no event of its own."""

    def guards(self, t, x, mode):
        jumps = super().guards(t, x, mode)[self.written.index("jumps")]
        return jnp.stack([jumps if name == "jumps" else x[0] - self.place for name in self.written])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`guards` must be smooth")
def test_it_does_not_move_with_a_guard_that_rises_at_that_place():
    """A guard that is watched again has no derivative of its time: forward gave 1.6 times, reverse 0 for it."""
    motion = moved(Waiting, PLACE, "falls", "jumps", throw=False)
    assert motion.status == hs.Status.guard_jumps and motion.events.count == 1


class Turning(hs.AbstractHybridSystem):
    """A point on a circle, and the line through the origin at an angle, which it passes once a turn."""

    angle: jax.Array

    def flow(self, t, x, mode):
        return jnp.stack([-x[1], x[0]])

    def guards(self, t, x, mode):
        return (self.angle - jnp.arctan2(x[1], x[0]))[None]

    def transition(self, event, t, x, mode):
        return x, mode


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`guards` must be smooth")
def test_one_that_jumps_above_zero_does_no_harm():
    """The angle jumps from pi to -pi on the way to the next time, where nothing happens."""

    def second(angle):
        return hs.solve(Turning(angle), jnp.array([1.0, 0.0]), t1=8.0, max_events=4).events.time[1]

    time, slope = jax.value_and_grad(second)(0.5)
    assert_close(time, 0.5 + 2 * jnp.pi, 1e-8)
    assert_close(slope, 1.0, 1e-8)


class Later(hs.AbstractHybridSystem):
    """x' = 1 until the place, then -x: a guard that has no rate on either side of it, in x or in t."""

    place: jax.Array
    of: str = eqx.field(static=True)

    def flow(self, t, x, mode):
        return jnp.where(mode == 1, -x, 1.0)

    def guards(self, t, x, mode):
        return jnp.where((t if self.of == "t" else x) < self.place, 1.0, -1.0)[None]

    def transition(self, event, t, x, mode):
        return x, jnp.ones_like(mode)


class Located(Later):
    located_discontinuities = True


def later(kind, place, of, **given):
    return hs.solve(kind(place, of), 0.0, 0, t1=2.0, **given)


END, SLOPE = 0.7 * jnp.exp(-1.3), 1.7 * jnp.exp(-1.3)
"""x(2) = place exp(place - 2), and its derivative."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:`guards` must be smooth")
def test_one_that_jumps_and_then_stands_still_fires_once():
    """It need not fall on to be told from one that repeats; declared, its time has a derivative."""
    motion = later(Later, PLACE, "t", throw=False)
    assert motion.status == hs.Status.guard_jumps and motion.events.count == 1
    assert_close(motion.final, END, 1e-8)
    declared = lambda place: later(Later, place, "t", jump_ts=place[None]).final
    assert_close(jax.grad(declared)(PLACE), SLOPE, 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("of", ["t", "x"])
def test_as_a_comparison_that_is_an_event_it_is_right(of):
    """What the warning advises."""
    end = lambda place: later(Located, place, of).final
    assert_close(end(PLACE), END, 1e-8)
    assert_close(jax.grad(end)(PLACE), SLOPE, 1e-7)
