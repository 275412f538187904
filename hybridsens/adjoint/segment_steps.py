"""The steps of one segment, for the backward pass: as recorded, or run again where they were not kept."""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..flat_system import AbstractFlatSystem, Mode
from ..forward.record import Motion, StepRecord, empty_steps, segment, segment_end, segment_start
from ..forward.segment import solve_segment
from ..forward.solver import Stepper


class SegmentSteps(NamedTuple):
    """The steps of one segment."""

    mode: Mode
    record: StepRecord
    """Holds its steps, and perhaps others."""
    first: Int[Array, ""]
    last: Int[Array, ""]
    """One past its last step."""
    valid: Float[Array, ""]
    """1, or nan where the steps are lost."""


def recorded_steps(motion: Motion, j: Int[Array, ""]) -> SegmentSteps:
    """Segment j of a motion whose steps were all recorded."""
    mode, first, last = segment(motion, j)
    return SegmentSteps(mode, motion.steps, first, last, jnp.ones_like(motion.t))


def recomputed_steps(
    system: AbstractFlatSystem, stepper: Stepper, start, t1, motion: Motion, j: Int[Array, ""]
) -> SegmentSteps:
    """Segment j, run again from where its event left it, on to its next event.

    It takes the same steps but for rounding, by which another program differs: where a gap closes slowly, that may be
    another time or one step more. A segment that ends elsewhere makes the gradient nan: a wrong one must not pass.
    """
    mode, first, _ = segment(motion, j)
    events, previous = motion.events, jnp.maximum(j - 1, 0)
    t = segment_start(motion, j, start[0])
    x = jnp.where(j > 0, events.states.after[previous], start[1])
    first_step = jnp.where(j > 0, events.first_step[previous], 0)
    again = dataclasses.replace(
        motion, t=t, x=x, mode=mode, steps=empty_steps(t, x, stepper.segment_steps), first_step=first_step,
        rejected=jnp.array(0),
    )  # fmt: skip
    # A motion that ran out of steps ended within a segment.
    again, _ = solve_segment(system, stepper, jnp.where(motion.status.reached_end, t1, motion.t), again)
    end = segment_end(motion, j)
    off = jnp.finfo(t.dtype).eps ** 0.5 * jnp.maximum(jnp.abs(end), jnp.abs(t1 - start[0]))
    valid = jnp.where(jnp.abs(again.t - end) <= off, 1.0, jnp.nan).astype(t.dtype)
    return SegmentSteps(mode, again.steps, jnp.zeros_like(first), again.steps.count, valid)
