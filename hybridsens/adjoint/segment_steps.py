"""The steps of one segment, for the way back: as they were recorded, or run again."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..forward.record import Motion, StepRecord, empty_steps, segment
from ..forward.segment import Stepper, solve_segment
from ..hybrid import AbstractHybridSystem, Mode
from ..precision import time_resolution

Steps = tuple[Mode, StepRecord, Int[Array, ""], Int[Array, ""], Float[Array, ""]]
"""Mode of the segment, a record that holds its steps, its first step, one past its last, and 1 (nan if they are
lost)."""


def recorded_steps(motion: Motion, j: Int[Array, ""]) -> Steps:
    """Segment j of a motion whose steps were all recorded."""
    mode, first, last = segment(motion, j)
    return mode, motion.steps, first, last, jnp.ones_like(motion.t)


def recomputed_steps(
    system: AbstractHybridSystem, stepper: Stepper, start, t1, motion: Motion, j: Int[Array, ""]
) -> Steps:
    """Segment j, run again from where its event left it by the same steps as before, on to its next event.

    A segment that does not come back as it was makes the gradient nan: a wrong one must not pass.
    """
    mode, first, last = segment(motion, j)
    events, previous = motion.events, jnp.maximum(j - 1, 0)
    t = jnp.where(j > 0, events.time[previous], start[0])
    x = jnp.where(j > 0, events.after[previous], start[1])
    first_step = jnp.where(j > 0, events.first_step[previous], 0)
    again = dataclasses.replace(
        motion, t=t, x=x, mode=mode, steps=empty_steps(t, x, stepper.segment_steps), first_step=first_step,
        rejected=jnp.array(0),
    )  # fmt: skip
    again, _ = solve_segment(system, stepper, t1, again)
    end = jnp.where(j < events.count, events.time[jnp.minimum(j, events.time.shape[0] - 1)], motion.t)
    same = (again.steps.count == last - first) & (jnp.abs(again.t - end) <= time_resolution(end, 3))
    return mode, again.steps, jnp.zeros_like(first), again.steps.count, jnp.where(same, 1.0, jnp.nan).astype(t.dtype)
