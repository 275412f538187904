"""Known times that fall together: a dose and a jump of the flow, ticks of a clock, a delay of 0. By closed forms."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close

DECAY, END = 0.2, 10.0


class Infusion(hs.AbstractHybridSystem):
    """An infusion starts at a jump time; a dose comes at a scheduled time, or where a guard of time falls."""

    dose_time: jax.Array
    start: jax.Array
    guarded: bool

    def flow(self, t, x, mode):
        return -DECAY * x + jnp.where(t > self.start, 2.0, 0.0)

    def guards(self, t, x, mode):
        return jnp.where(mode > 0, 1.0, self.dose_time - t)[None] if self.guarded else jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return None if self.guarded else self.dose_time[None]

    def jump_times(self):
        return self.start[None]

    def transition(self, event, t, x, mode):
        return x + 5.0, mode + 1


def left(times, guarded, adjoint=None):
    return hs.solve(Infusion(times[0], times[1], guarded), 0.0, 0, t1=END, adjoint=adjoint).final


def left_exactly(times):
    dose_time, start = times
    return 5 * jnp.exp(-DECAY * (END - dose_time)) + 2 / DECAY * (1 - jnp.exp(-DECAY * (END - start)))


APART = jnp.array([-1e-2, -1e-14, -4e-15, -4.5e-16, 0.0, 4.5e-16, 4e-15, 1e-14, 1e-2])
"""How much later than the infusion the dose comes: the clock takes 1e-14 to pass a jump time."""


@pytest.mark.parametrize(
    "guarded", [pytest.param(False, id="scheduled"), pytest.param(True, id="guard", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "method",
    [pytest.param(jax.grad, id="reverse"), pytest.param(jax.jacfwd, id="forward", marks=pytest.mark.slow)],
)
def test_a_dose_at_a_jump_time_has_its_own_derivative(guarded, method):
    adjoint = hs.ForwardSensitivities() if method is jax.jacfwd else None
    times = jnp.stack([3 + APART, jnp.full_like(APART, 3.0)], axis=1)
    found = jax.jit(jax.vmap(method(lambda times: left(times, guarded, adjoint))))(times)
    assert_close(found, jax.vmap(jax.grad(left_exactly))(times), 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(
    "guarded, method",
    [
        pytest.param(False, jax.jacrev, id="scheduled, reverse"),
        pytest.param(False, jax.jacfwd, id="scheduled, forward"),
        pytest.param(True, jax.jacrev, id="guard, reverse"),
        pytest.param(True, jax.jacfwd, id="guard, forward"),
    ],
)
def test_a_sample_at_a_dose_at_a_jump_time_is_the_state_after_it(guarded, method):
    adjoint = hs.ForwardSensitivities() if method is jax.jacfwd else None

    def sampled(times):
        ts = jnp.stack([1.0, times[2]])
        return hs.solve(Infusion(times[0], times[1], guarded), 0.0, 0, t1=END, ts=ts, adjoint=adjoint).x[1]

    times = jnp.stack([3 + APART[2:-2], jnp.full(5, 3.0), jnp.full(5, 3.0)], axis=1)
    assert_close(jax.jit(jax.vmap(sampled))(times), jnp.full(5, 5.0), 1e-8)
    found = jax.jit(jax.vmap(method(sampled)))(times)
    by_dose = 5 * DECAY
    assert_close(found, jnp.tile(jnp.array([by_dose, -2.0, 2.0 - by_dose]), (5, 1)), 1e-7)


class Clock(hs.AbstractHybridSystem):
    """A clock that reads its ticks from a list."""

    at: jax.Array

    def flow(self, t, x, mode):
        return -DECAY * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return jnp.where(mode < self.at.size, self.at[jnp.minimum(mode, self.at.size - 1)], jnp.inf)[None]

    def transition(self, event, t, x, mode):
        return x + 5.0, mode + 1


def ticked(at):
    return hs.solve(Clock(at), 0.0, 0, t1=END).final


@pytest.mark.slow
def test_a_clock_may_tick_twice_in_one_instant():
    at = jnp.array([1.0, 3.0, jnp.nextafter(jnp.array(3.0), 4.0), 5.0])
    each = 5 * jnp.exp(-DECAY * (END - at))
    assert_close(ticked(at), jnp.sum(each), 1e-8)
    assert_close(jax.grad(ticked)(at), DECAY * each, 1e-7)


@pytest.mark.slow
def test_a_tick_that_is_moved_into_the_past_comes_at_once():
    at = jnp.array([1.0, 3.0, 2.0, 5.0])
    came = jnp.array([1.0, 3.0, 3.0, 5.0])
    each = 5 * jnp.exp(-DECAY * (END - came))
    assert_close(ticked(at), jnp.sum(each), 1e-8)
    moves_with = jnp.array([DECAY * each[0], DECAY * (each[1] + each[2]), 0.0, DECAY * each[3]])
    assert_close(jax.grad(ticked)(at), moves_with, 1e-7)


class Relay(hs.AbstractHybridSystem):
    """y' = -y grows by 1 with each arrival of a signal, which is passed on three times, after `delays`."""

    delays: jax.Array
    first: jax.Array

    def flow(self, t, x, mode):
        return {"y": -x["y"], "due": jnp.zeros_like(x["due"])}

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return jnp.concatenate([self.first[None], mode["queue"].times(x["due"])])

    def transition(self, event, t, x, mode):
        choose = lambda first, one, other: jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)
        arrived = choose(event == 0, mode["queue"], mode["queue"].take(event - 1))
        due, sent = arrived.put(x["due"], t + self.delays[jnp.minimum(mode["sent"], 2)])
        more = mode["sent"] < 3
        y = x["y"] + jnp.where(event == 0, 0.0, 1.0)
        return {"y": y, "due": jnp.where(more, due, x["due"])}, {
            "sent": mode["sent"] + 1,
            "queue": choose(more, sent, arrived),
        }


@jax.jit
def passed_on(delays, first):
    """The motion, and the derivatives of y(2) by the delays."""

    def end(delays):
        start, mode = {"y": 0.0, "due": jnp.zeros(1)}, {"sent": 0, "queue": hs.DelayQueue.empty(1)}
        motion = hs.solve(Relay(delays, first), start, mode, t1=2.0, max_events=8, throw=False)
        return motion.final["y"], motion

    slope, motion = jax.grad(end, has_aux=True)(delays)
    return motion, slope


@pytest.mark.parametrize("first", [0.0, 0.37, 1.0])
@pytest.mark.parametrize(
    "delays",
    [(0.2, 0.3, 0.1), (0.2, 1e-12, 0.0), (0.2, 0.0, 0.3), (0.0, 0.0, 0.0), (0.5, 1e-17, 0.1), (0.1, jnp.inf, 0.0)],
)
def test_what_is_passed_on_at_once_comes_too(delays, first):
    """Without a delay a time is put where the same one was taken, and none may be lost; one of inf ends the relay."""
    motion, slope = passed_on(jnp.array(delays), jnp.array(first))
    arrivals = first + jnp.cumsum(jnp.array(delays))
    left = jnp.where(arrivals < 2, jnp.exp(arrivals - 2), 0.0)
    assert motion.status == hs.Status.successful
    assert int(motion.events.count) == 1 + int(jnp.sum(arrivals < 2)) and not bool(motion.mode["queue"].taken.any())
    assert_close(motion.final["y"], left.sum(), 1e-7)
    assert_close(slope, jnp.cumsum(left[::-1])[::-1], 1e-7)


def test_the_next_place_of_a_queue_is_the_one_that_is_taken():
    """What a delayed event carries is kept there: also where a place before others has become free."""
    queue, due = hs.DelayQueue(jnp.array([True, False, True]), jnp.array(False)), jnp.zeros(3)
    for place, freed in ((1, 0), (0, 2), (2, 1)):
        assert int(queue.next_place) == place
        due, queue = queue.put(due, 5.0 + place)
        assert bool(queue.taken.all()) and float(due[place]) == 5.0 + place
        queue = queue.take(jnp.array(freed))
