"""Events that accumulate: a motion beyond their limit says so, and does not go on in the shortest of steps."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs


class Bouncing(hs.AbstractHybridSystem):
    """A ball whose impacts accumulate at t* = sqrt(2 h / g) (1 + e) / (1 - e)."""

    e: jax.Array

    def flow(self, t, x, mode):
        return jnp.stack([x[1], jnp.array(-9.81)])

    def guards(self, t, x, mode):
        return x[:1]

    def transition(self, event, t, x, mode):
        return jnp.stack([x[0], -self.e * x[1]]), mode


@jax.jit
def fall(e, height):
    return hs.solve(Bouncing(e), jnp.stack([height, 0 * height]), t1=100.0, throw=False)


@pytest.mark.parametrize(("e", "height"), [(0.2, 1.0), (0.5, 2.0), (0.7, 1.0), (0.9, 0.5)])
def test_impacts_that_accumulate_are_told(e, height):
    """A ball left below the floor by rounding, too slow to come above it, took 4 units of the last place a step."""
    motion = fall(e, height)
    told = hs.Status.event_repeats, hs.Status.max_events_reached
    assert any(motion.status == status for status in told), str(motion.status)
    assert abs(motion.end_time - (2 * height / 9.81) ** 0.5 * (1 + e) / (1 - e)) < 1e-5
    assert motion.steps.accepted + motion.steps.rejected < 4000  # room was left
