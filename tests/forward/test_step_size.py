"""A step size that cannot become smaller ends the motion, with the status that says so."""

import jax.numpy as jnp

import hybridsens as hs
from tests.closeness import assert_close


class Exploding(hs.AbstractHybridSystem):
    """x = 1 / (1 - t): no step passes t = 1."""

    def flow(self, t, x, mode):
        return x**2

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


def test_a_singularity_is_not_taken_for_a_lack_of_room():
    """The last steps are as long as they were before, by rounding: more of them would not help."""
    motion = hs.solve(Exploding(), 1.0, t1=2.0, ts=jnp.array([0.5, 1.5]), throw=False)
    assert motion.status == hs.Status.step_size_underflow, hs.Status[motion.status]
    assert_close(motion.x[0], 2.0, 1e-7)
    assert jnp.isnan(motion.x[1])
