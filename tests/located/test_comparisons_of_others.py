"""Comparisons that are events and made of others, of a count or of a clock: against closed forms and modes by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens
from tests.problems.springs import TOLERANCES, Spring, SpringInModes, moved


class PulseWidth(hybridsens.AbstractHybridSystem):
    """A pulse of height 2 in each period, and a sawtooth."""

    located_discontinuities = True
    period: jax.Array
    duty: jax.Array

    def flow(self, t, x, mode):
        since_tick = t % self.period
        return 2 * jnp.where(since_tick < self.duty * self.period, 1.0, 0.0) + since_tick

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


@pytest.mark.slow
@pytest.mark.filterwarnings("error::hybridsens.DiscontinuityWarning")
def test_a_remainder_of_time_ticks():
    """Until t = 2 there are three pulses of length 0.35 * 0.7 and two and a part teeth; a tick ends a tooth, and
    begins a pulse."""
    final = lambda period, duty: hybridsens.solve(PulseWidth(period, duty), 0.0, t1=2.0, **TOLERANCES).final
    value, slopes = jax.value_and_grad(final, (0, 1))(jnp.array(0.7), jnp.array(0.35))
    teeth, by_period = 0.7**2 + 0.6**2 / 2, 2 * 0.7 - 2 * 0.6
    np.testing.assert_allclose(value, 6 * 0.35 * 0.7 + teeth, atol=1e-9)
    np.testing.assert_allclose(slopes, [6 * 0.35 + by_period, 6 * 0.7], atol=1e-8)


class Counted(hybridsens.AbstractHybridSystem):
    """x falls to 0 and is raised by 1, at twice the rate from the second time on: the count is a part of the state."""

    located_discontinuities = True
    rate: jax.Array

    def flow(self, t, x, mode):
        fast = (x["count"] >= 2) & (jax.nn.relu(x["level"]) > -1)
        return {"level": -self.rate * jnp.where(fast, 2.0, 1.0), "count": jnp.zeros(())}

    def guards(self, t, x, mode):
        return x["level"][None]

    def transition(self, event, t, x, mode):
        return {"level": x["level"] + 1, "count": x["count"] + 1}, mode


@pytest.mark.slow
def test_a_count_that_comes_to_the_number_it_is_compared_with_counts():
    """It stands still there, so no guard falls. After the second raise the level is 1, then 2 rate (2.3 - 2 / rate) is
    lost, and it is raised once more."""
    final = lambda rate: hybridsens.solve(Counted(rate), {"level": 1.0, "count": 0.0}, t1=2.3).final["level"]
    np.testing.assert_allclose(final(jnp.array(1.1)), 6 - 4.6 * 1.1, atol=1e-8)


@pytest.mark.slow
def test_a_comparison_made_of_another_turns_with_it():
    """The overlap stays 0 below the place, so that nothing tells there that it is not above 0: its outcome changes with
    that of the choice that it is made of."""

    class Overlapping(Spring):
        def flow(self, t, x, mode):
            overlap = jnp.maximum(x["q"] - self.place, 0)
            return {"q": x["v"], "v": -self.k * x["q"] + jnp.where(overlap > 0, self.force, 0.0)}

    spring, by_mode = (kind(4.0, -1.0, 0.3) for kind in (Overlapping, SpringInModes))
    one, other = (moved(*given).final["q"] for given in ((spring, None), (by_mode, jnp.array(True))))
    np.testing.assert_allclose(one, other, atol=1e-9)


class Never(hybridsens.AbstractHybridSystem):
    """x' = 1: max(sin(3 t + p), 0) is never below 0, wherever it begins to rise from there."""

    p: jax.Array
    located_discontinuities = True

    def flow(self, t, x, mode):
        return jnp.where(jax.nn.relu(jnp.sin(3 * t + self.p)) >= 0, 1.0, 2.0)

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


@pytest.mark.slow
def test_a_guard_that_begins_to_rise_at_an_event_has_not_fallen_by_where_that_was_placed():
    """Most of these ended with `event_repeats`."""
    run = jax.jit(jax.vmap(lambda p: hybridsens.solve(Never(p), 0.0, t1=6.0, max_events=12).final))
    assert run(jnp.linspace(0.1, 3.0, 40)).tolist() == pytest.approx([6.0] * 40, abs=1e-12)
