"""Events whose times are known before they come, against closed forms: doses, clocks, delays."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

METHODS = [hs.Replay(), pytest.param(hs.ForwardSensitivities(), marks=pytest.mark.slow)]
BOTH = pytest.mark.parametrize("adjoint", METHODS, ids=["reverse", "forward"])
TIGHT = dict(rtol=1e-11, atol=1e-11)


class Doses(hs.AbstractHybridSystem):
    """x' = -k x, and x grows by `amount[i]` at `at[i]`; nothing is watched."""

    k: jax.Array
    amount: jax.Array
    at: jax.Array

    def flow(self, t, x, mode):
        return -self.k * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return self.at

    def transition(self, event, t, x, mode):
        return x + self.amount[event], mode


class Searched(Doses):
    """The same doses by guards."""

    def guards(self, t, x, mode):
        return self.at - t

    def scheduled_times(self, x, mode):
        return None


class Echo(hs.AbstractHybridSystem):
    """y' = speed; at y = level it falls by 1, and `tau` later it doubles. `slide` moves what is scheduled."""

    speed: jax.Array
    level: jax.Array
    tau: jax.Array
    slide: float = eqx.field(default=0.0, static=True)

    def flow(self, t, x, mode):
        return {"y": self.speed, "due": jnp.full_like(x["due"], self.slide)}

    def guards(self, t, x, mode):
        return (self.level - x["y"])[None]

    def scheduled_times(self, x, mode):
        return mode.times(x["due"])

    def transition(self, event, t, x, mode):
        due, later = mode.put(x["due"], t + self.tau)
        fell = {"y": x["y"] - 1, "due": due}, later
        came = {"y": 2 * x["y"], "due": x["due"]}, mode.take(event - 1)
        return jax.tree.map(lambda one, other: jnp.where(event == 0, one, other), fell, came)


class Clock(hs.AbstractHybridSystem):
    """x' = mode, which is the number of ticks so far; the clock never ends."""

    period: jax.Array

    def flow(self, t, x, mode):
        return mode * self.period

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return ((mode + 1) * self.period)[None]

    def transition(self, event, t, x, mode):
        return x, mode + 1


DOSES = Doses(jnp.array(0.7), jnp.arange(1.0, 8.0), jnp.array([3.0, 0.0, 1.0, 1.0, 8.0, -1.0, 9.0]))


def doses(system, adjoint=None, max_events=8):
    return hs.solve(system, 0.5, t1=8.0, max_events=max_events, adjoint=adjoint, **TIGHT)


@BOTH
def test_doses_have_their_closed_form(adjoint):
    """In any order, two at one instant, one at t0 and one at t1; none before or after. Steps end on them exactly."""
    come = np.array([1, 2, 3, 0, 4])

    def exact(system):
        left = jnp.exp(-system.k * (8 - system.at[come]))
        return 0.5 * jnp.exp(-8 * system.k) + jnp.sum(system.amount[come] * left)

    def computed(system):
        solution = doses(system, adjoint)
        return solution.final, solution

    way = jax.jacrev if isinstance(adjoint, hs.Replay) else jax.jacfwd
    slope, solution = way(computed, has_aux=True)(DOSES)
    assert solution.events.guard.tolist() == [*come, -1, -1, -1]
    assert solution.events.time[:5].tolist() == DOSES.at[come].tolist()
    assert_close(solution.final, exact(DOSES), 1e-10)
    for found, expected in zip(jax.tree.leaves(slope), jax.tree.leaves(jax.grad(exact)(DOSES)), strict=True):
        assert_close(found, expected, 1e-9)


def test_what_is_known_takes_no_search():
    """Steps that are tried twice are those of the error control, not those that find an event."""
    searched = hs.solve(Searched(*jax.tree.leaves(DOSES)), 0.5, t1=8.0, max_events=8, **TIGHT)
    assert doses(DOSES).steps.rejected == 0 < searched.steps.rejected
    assert searched.events.count == 5
    assert_close(doses(DOSES).final, searched.final, 1e-9)


@BOTH
def test_a_delay_moves_with_its_cause(adjoint):
    """Falls at t_0 = (level - y0) / speed; the echo comes tau later, and brings the next fall nearer."""

    def computed(p, adjoint):
        speed, level, tau, y0 = p
        start, queue = {"y": y0, "due": jnp.zeros(2)}, hs.DelayQueue.empty(2)
        solution = hs.solve(Echo(speed, level, tau), start, queue, t1=1.7, max_events=6, adjoint=adjoint)
        return jnp.append(solution.events.time[:4], solution.final["y"])

    def exact(p):
        speed, level, tau, y0 = p
        first = (level - y0) / speed
        at_echo = 2 * (level - 1 + speed * tau)
        second = first + tau + (level - at_echo) / speed
        final = 2 * (level - 1 + speed * tau) + speed * (1.7 - second - tau)
        return jnp.stack([first, first + tau, second, second + tau, final])

    p = jnp.array([1.0, 1.25, 0.25, 0.5])
    at_once = computed(p.at[2].set(0.0), adjoint)  # also a delay of no length ends
    assert_close(at_once, exact(p.at[2].set(0.0)), 1e-12)
    way = jax.jacrev if isinstance(adjoint, hs.Replay) else jax.jacfwd
    assert_close(computed(p, adjoint), exact(p), 1e-12)
    assert_close(way(lambda p: computed(p, adjoint))(p), jax.jacfwd(exact)(p), 1e-12)


class Late(hs.AbstractHybridSystem):
    """x' = speed; at x = level an alarm is set to `alarm`, at which x doubles."""

    speed: jax.Array
    level: jax.Array
    alarm: jax.Array

    def flow(self, t, x, mode):
        return self.speed

    def guards(self, t, x, mode):
        return jnp.where(mode == 0, self.level - x, 1.0)[None]

    def scheduled_times(self, x, mode):
        return jnp.where(mode == 1, self.alarm, 5.0)[None]

    def transition(self, event, t, x, mode):
        return jnp.where(event == 0, x, 2 * x), mode + 1


@pytest.mark.slow
@BOTH
def test_a_time_that_has_passed_comes_at_once(adjoint):
    """The level is met at 2; x(3) = 2 level + speed (3 - 2), and where it is met moves the alarm with it."""

    def final(p):
        motion = hs.solve(Late(*p), 0.0, 0, t1=3.0, max_events=4, max_steps=64, adjoint=adjoint, **TIGHT)
        return motion.final, motion

    p = jnp.array([0.5, 1.0, 1.3])
    gradient, motion = (jax.jacfwd if adjoint.forward_mode else jax.jacrev)(final, has_aux=True)(p)
    assert_close(motion.events.time[:2], [2.0, 2.0], 1e-10)
    assert_close(motion.final, 2.5, 1e-10)
    assert_close(gradient, [3.0, 1.0, 0.0], 1e-9)  # level + 3 speed


@pytest.mark.slow
@BOTH
def test_a_dose_at_the_end_is_in_the_sample_there(adjoint):
    """x(2) = 3 exp(-2 k) + a_0 exp(-k) + a_1 exp(-k (2 - t_1)); a dose can come earlier, but not later."""
    at, amount, k = jnp.array([1.0, 2.0]), jnp.array([1.0, 2.0]), 0.5

    def samples(amount, at):
        system, settings = Doses(jnp.array(k), amount, at), dict(max_events=4, max_steps=64, adjoint=adjoint, **TIGHT)
        return hs.solve(system, 3.0, t1=2.0, ts=jnp.array([1.0, 2.0]), **settings).x

    by_amount, by_at = (jax.jacfwd if adjoint.forward_mode else jax.jacrev)(samples, (0, 1))(amount, at)
    decay = np.exp(-k)
    assert_close(by_amount, [[1.0, 0.0], [decay, 1.0]], 1e-9)
    assert_close(by_at[1], [k * decay, 2 * k], 1e-9)


def test_a_clock_ticks_for_ever():
    """x(n T) = T^2 (1 + 2 + ... + n - 1), and the time of every tick moves with the period."""
    final = lambda clock: hs.solve(clock, 0.0, 0, t1=50.5).final
    tick = lambda T: T**2 * 49 * 25 + (50.5 - 50 * T) * 50 * T
    value, slope = jax.value_and_grad(final)(Clock(jnp.array(1.0)))
    assert_close(value, tick(1.0), 1e-12)
    assert_close(slope.period, jax.grad(tick)(1.0), 1e-12)


def test_closed_over_times_are_differentiated():
    """A time that a method finds outside of its system reaches the gradient."""

    def final(at):
        class Kick(Clock):
            def scheduled_times(self, x, mode):
                return at[None]

        return hs.solve(Kick(jnp.array(3.0)), 0.0, 0, t1=2.0).final

    assert_close(jax.grad(final)(jnp.array(0.5)), -3.0, 1e-12)


def test_what_cannot_be_known_is_told():
    """A time that moves by itself, a queue without room, a clock that goes backward, an array of another shape."""
    start, queue = {"y": 0.5, "due": jnp.zeros(1)}, hs.DelayQueue.empty(1)
    echo = lambda **given: Echo(**({"speed": jnp.array(1.0), "level": jnp.array(1.0), "tau": jnp.array(0.2)} | given))
    outcome = lambda system: hs.solve(system, start, queue, t1=3.0, throw=False).status
    assert outcome(echo(slide=0.1)) == hs.Status.scheduled_time_moves
    assert outcome(echo(tau=jnp.array(2.0))) == hs.Status.queue_full
    assert outcome(echo()) == hs.Status.successful
    stands = hs.solve(Clock(jnp.array(-1.0)), 0.0, -1, t1=1.0, throw=False)
    assert stands.status == hs.Status.max_events_reached
    with pytest.raises(ValueError, match=r"`scheduled_times` must return an array of shape \(time,\)"):
        doses(Doses(DOSES.k, DOSES.amount, jnp.array(1.0)))
    with pytest.raises(ValueError, match="`places` must be an integer >= 1"):
        hs.DelayQueue.empty(0)


@pytest.mark.slow
def test_a_time_that_is_no_number_is_told():
    """Otherwise it would never come, and its dose be left out."""
    known = jnp.array([0.5, 1.0, 1.5])
    unknown = known.at[1].set(jnp.nan)
    outcome = lambda times: hs.solve(Doses(DOSES.k, jnp.ones(3), times), 1.0, 0, t1=2.0, throw=False).status
    assert outcome(known) == hs.Status.successful and outcome(unknown) == hs.Status.non_finite
    free = lambda times: hs.solve(Clock(jnp.array(1.0)), 0.0, 0, t1=2.5, jump_ts=times, throw=False).status
    assert jax.jit(free)(known) == hs.Status.successful and jax.jit(free)(unknown) == hs.Status.non_finite
