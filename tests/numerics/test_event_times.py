"""Costs read the times of one kind of event: in the order of time, inf where there are fewer, differentiable."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.numerics.event_times import first_times, sequence_number
from tests.closeness import assert_close


def test_the_first_that_are_wanted_are_taken_along_the_last_axis():
    """Of a batch, each row's own."""
    time = jnp.array([[1.0, 2.0, 3.0, jnp.inf], [4.0, 5.0, jnp.inf, jnp.inf]])
    wanted = jnp.array([[False, True, True, False], [True, False, False, False]])
    np.testing.assert_array_equal(first_times(time, wanted, 2), [[2.0, 3.0], [4.0, np.inf]])


class TwoClocks(hs.AbstractHybridSystem):
    """Two phases that grow until they reach 1."""

    event_names = ("slow", "fast")
    rates: jax.Array

    def flow(self, t, x, mode):
        return self.rates

    def guards(self, t, x, mode):
        return 1 - x

    def transition(self, event, t, x, mode):
        return x.at[event].set(0.0), mode


def spikes(rates, guard, count):
    """Times at which a phase came to 1."""
    return hs.solve(TwoClocks(rates), jnp.zeros(2), t1=3.2, max_events=16).events.times_of(guard, count)


@pytest.mark.parametrize("guard", [1, "fast"])
def test_times_of_a_guard_and_their_derivatives(guard):
    """t_k = k / rate, whatever else happens between; dt_k/drate = -k / rate^2. A spike that did not come is at inf."""
    rates, k = jnp.array([0.7, 1.3]), jnp.arange(1, 5)
    assert_close(spikes(rates, guard, 4), k / 1.3, 1e-9)
    slopes = jax.jacrev(lambda rates: spikes(rates, guard, 4))(rates)
    assert_close(slopes, jnp.stack([0.0 * k, -k / 1.3**2], axis=1), 1e-8)
    assert np.isinf(spikes(rates, 0, 4)).tolist() == [False, False, True, True]


def test_times_of_a_contact(unchecked):
    """Its impacts, or events of another kind: a ball at t = sqrt(2 h / g), and once more after 2 e v / g."""
    ball = hs.scenes.BouncingBall()
    events = hs.simulate(ball, ball.initial_state(), t1=1.0).events
    fall = np.sqrt(2 * 1.0 / 9.81)
    assert_close(events.times_of(0, 2)[0], fall, 1e-9)
    assert np.isinf(events.times_of(0, 2, hs.EventKind.RELEASE)).all()
    with pytest.raises(ValueError, match="`contact` must be from 0 to 0, but is 1"):
        events.times_of(1, 1)
    with pytest.raises(TypeError, match="must be its number, .* is the name 'floor'"):
        events.times_of("floor", 1)


@pytest.mark.parametrize("asked", [lambda event: event.sequence == 3, lambda event: event.times_of(0, 1)[0] > 0])
def test_one_event_knows_none_of_the_others(asked):
    """`until` is given one event at a time."""
    with pytest.raises(ValueError, match="not of one event: read its `time` and `count`"):
        hs.solve(TwoClocks(jnp.ones(2)), jnp.zeros(2), t1=0.1, until=lambda system, event: asked(event))


def test_what_cannot_be_asked_for_is_told():
    """A name that no event has, and more events than there is room for."""
    events = hs.solve(TwoClocks(jnp.ones(2)), jnp.zeros(2), t1=0.1, max_events=3).events
    with pytest.raises(ValueError, match=r"one of the names \(slow, fast\), but is 'quick'"):
        events.times_of("quick", 1)
    for count in (0, 4):
        with pytest.raises(ValueError, match=rf"from 1 to max_events = 3, but is {count}"):
            events.times_of(0, count)


def test_a_sequence_has_a_number_of_its_own():
    """The same events give the same, whatever stands in rows beyond them; another order, or one more, another."""
    codes = jnp.array([[0, 5, 2, -1], [0, 5, 2, 7], [5, 0, 2, -1], [0, 5, -1, -1], [0, 5, 2, 7]])
    first, same, swapped, shorter, longer = sequence_number(codes, jnp.array([3, 3, 3, 2, 4])).tolist()
    assert first == same and len({first, swapped, shorter, longer}) == 4
    assert int(sequence_number(codes[0], jnp.array(3))) == first
