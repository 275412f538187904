"""States at the times asked for: one more step of the solver, from the recorded step that spans the time.

Dense output is less exact than the steps themselves, and Diffrax has it in cubic form only for some solvers. A shorter
step is as exact as the recorded one, for any solver, and its derivative is that of a step.
"""

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..hybrid import AbstractHybridSystem
from .record import Motion, segment
from .solver import one_step


def sample_states(
    system: AbstractHybridSystem, solver: diffrax.AbstractSolver, motion: Motion, ts: Float[Array, "sample"]
) -> Float[Array, "sample state"]:
    """States at `ts`; at an event, the state just after it. Differentiable in the recorded grid and in ts."""
    ends = motion.events.steps
    passed = jnp.arange(ends.shape[0]) < motion.events.count

    def state_at(t):
        k = jnp.searchsorted(motion.steps.t, t, side="right") - 1
        k = jnp.clip(k, 0, motion.steps.count)
        mode, _, _ = segment(motion, jnp.sum(passed & (ends <= k)))
        return one_step(solver, system, mode, motion.steps.t[k], t, motion.steps.x[k])

    return jax.vmap(state_at)(ts)
