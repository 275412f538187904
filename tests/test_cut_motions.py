"""A motion that is cut in two is the whole motion, however near to an event the cut comes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

CLOCKS = pytest.mark.parametrize("t0", [0.0, pytest.param(1e6, marks=pytest.mark.slow), 1.7e9])
CUTS = np.arange(-60, 61, 3)
"""In units of the last place of the event's time."""


class Neuron(hs.AbstractHybridSystem):
    """x' = 2 - x from 0; fires and is reset at 1, that is every ln 2."""

    def flow(self, t, x, mode):
        return 2.0 - x

    def guards(self, t, x, mode):
        return 1.0 - x[None]

    def transition(self, event, t, x, mode):
        return 0.0 * x, mode + 1


class Ball(hs.AbstractScene):
    """A ball above a table that shakes."""

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -9.81 - 0.3 * v

    def gap(self, t, q):
        return q - 0.05 * jnp.sin(3 * t)

    def restitution(self):
        return jnp.array([0.8])


def cuts(times, count):
    """Times just before and after each event."""
    times = np.asarray(times[:count])
    return jnp.asarray((times[:, None] + CUTS * np.spacing(times)[:, None]).ravel())


@CLOCKS
def test_no_spike_is_lost_or_doubled(t0):
    """A spike that fell just before the cut was left to the second part, whose guard waited below zero for ever."""
    part = lambda x, mode, t0, t1: hs.solve(Neuron(), x, mode, t0=t0, t1=t1, max_events=16, max_steps=512)
    whole = part(0.0, 0, t0, t0 + 2.5)

    def in_two(cut):
        first = part(0.0, 0, t0, cut)
        return part(first.final, first.mode, cut, t0 + 2.5)

    second = jax.jit(jax.vmap(in_two))(cuts(whole.events.time, 3))
    assert whole.events.count == 3
    assert set(second.mode.tolist()) == {3}
    near = max(1e-7, 1e3 * np.spacing(t0))
    assert_close(second.final, np.full(second.final.shape, 2 - 2 * np.exp(3 * np.log(2) - 2.5)), near)


@pytest.mark.slow
@CLOCKS
def test_the_end_of_a_motion_at_an_impact_begins_another(t0):
    """It was refused as a penetration by as much as the ball moves within what the clock can tell."""
    part = lambda state, t0, t1: hs.simulate(Ball(), state, t0=t0, t1=t1, max_events=16, max_steps=512)
    start = hs.State([1.0], [0.0])
    whole = part(start, t0, t0 + 2.0)

    def in_two(cut):
        first = part(start, t0, cut)
        second = part(first.final, cut, t0 + 2.0)
        return second.final.q[0], first.events.count + second.events.count

    q, count = jax.jit(jax.vmap(in_two))(cuts(whole.events.time, 3))
    assert whole.events.count == 3
    assert set(count.tolist()) == {3}
    assert_close(q, np.full(q.shape, whole.final.q[0]), max(1e-7, 1e4 * np.spacing(t0)))


class Spiking(Neuron):
    """x' = 5 - x: fires every ln(5/4)."""

    def flow(self, t, x, mode):
        return 5.0 - x


@pytest.mark.slow
def test_no_cut_loses_a_spike():
    """A spike fired neither before a cut nor at it where the cut lay just so far behind it that two rules, for what is
    near the end, disagreed by rounding."""
    part = lambda x, mode, t0, t1: hs.solve(Spiking(), x, mode, t0=t0, t1=t1, max_events=16, max_steps=512)
    whole = part(0.0, 0, 1.0, 3.5)
    times = np.asarray(whole.events.time[:3])
    every = times[:, None] + np.arange(400) * np.spacing(times)[:, None]

    def modes(cut):
        first = part(0.0, 0, 1.0, cut)
        return part(first.final, first.mode, cut, 3.5).mode

    assert set(jax.jit(jax.vmap(modes))(jnp.asarray(every.ravel())).tolist()) == {int(whole.mode)}


@pytest.mark.slow
def test_an_end_behind_an_impact_lies_above_the_floor_at_a_late_clock_in_single_precision():
    """What fell by less than 256 units of the clock's last place before the end was left below: by 5 cm at 1000 s.
    What is not told from the end falls for the shortest step, 1.9e-3 s, at 4.4 m/s: 8 mm."""
    number = lambda value: jnp.asarray(value, jnp.float32)

    def final(after):
        start = hs.State(number([1.0]), number([0.0]))
        return hs.simulate(Ball(), start, t0=number(1000.0), t1=after, rtol=1e-5, atol=1e-5, max_events=16).final.q[0]

    first = hs.simulate(Ball(), hs.State([1.0], [0.0]), t0=1000.0, t1=1001.0).events.time[0]
    ends = number(first) + jnp.arange(0, 300, 10) * number(np.spacing(np.float32(1000.0)))
    depth = 0.05 * jnp.sin(3 * ends.astype(float)) - jax.jit(jax.vmap(final))(ends).astype(float)
    assert depth.max() < 1e-2
