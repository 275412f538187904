"""An event may put the guard of another below zero: that fires at once, however little it is below, at a late clock and
in single precision too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class TwoNeurons(hs.AbstractHybridSystem):
    """Neuron 0 fires by its drive, and lifts neuron 1, which leaks, above its threshold."""

    rate: jax.Array
    weight: jax.Array

    def flow(self, t, x, mode):
        return self.rate * jnp.stack([1.2 - x[0], -x[1]])

    def guards(self, t, x, mode):
        return 1 - x

    def transition(self, event, t, x, mode):
        after = jnp.where(event == 0, x.at[0].set(0.0).at[1].add(self.weight), x.at[1].add(-1.0))
        return after, mode.at[event].add(1)


@pytest.mark.parametrize(
    ("t0", "rate", "over"), [(1e6, 100.0, 1e-5), (1e9, 10.0, 1e-3), (1.7e9, 1.0, 1e-3), (1.7e9, 10.0, 1e-2)]
)
def test_at_a_late_clock(t0, rate, over):
    """Neuron 1 begins to fall from above its threshold, so that its guard rises: it has fired all the same."""
    system = TwoNeurons(jnp.array(rate), jnp.array(1 + over))
    solution = hs.solve(system, jnp.zeros(2), jnp.zeros(2, int), t0=t0, t1=t0 + 2.5 / rate)
    assert solution.mode.tolist() == [1, 1]
    shown = 1e-12 * t0  # how exactly an event is placed: see `MOST_RELAXED`
    assert_close(solution.final[1], over * np.exp(np.log(6.0) - 2.5), within=1e-6 + rate * shown)


@pytest.mark.parametrize("over", [0.1, 0.01])
def test_in_single_precision(over):
    system = TwoNeurons(jnp.float32(1.0), jnp.float32(1 + over))
    start, mode = jnp.zeros(2, jnp.float32), jnp.zeros(2, int)
    solution = hs.solve(system, start, mode, t1=200.0, rtol=1e-5, atol=1e-5, max_events=256)
    spikes = int(200 / np.log(6.0))
    assert solution.mode.tolist() == [spikes, spikes]
