"""The steps of one segment, for the backward pass: as recorded, or run again where they were not kept."""

import dataclasses
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import AbstractFlatSystem, Mode
from ..forward.flow_jumps import Step, first_jump, jumps_inside
from ..forward.record import Motion, StepRecord, empty_steps, segment, segment_end, segment_start
from ..forward.segment import solve_segment
from ..forward.solver import Stepper
from ..status import Status


class SegmentSteps(NamedTuple):
    """The steps of one segment."""

    mode: Mode
    record: StepRecord
    """Holds its steps, and perhaps others."""
    first: Int[Array, ""]
    last: Int[Array, ""]
    """One past its last step."""
    valid: Bool[Array, ""]
    """Whether they are those of the motion: steps that are run again may be others."""


def recorded_steps(motion: Motion, j: Int[Array, ""]) -> SegmentSteps:
    """Segment j of a motion whose steps were all recorded."""
    mode, first, last = segment(motion, j)
    return SegmentSteps(mode, motion.steps, first, last, jnp.array(True))


class Rerun(NamedTuple):
    """What a segment needs to be run again."""

    system: AbstractFlatSystem
    stepper: Stepper
    start: tuple[Float[Array, ""], Float[Array, "state"]]
    """Of the motion: (t0, x0)."""
    t1: Float[Array, ""]
    least_state: Any
    """For `flow_jumps.told_of_flow_jumps`; None where jumps of the flow are known to do no harm."""


def recomputed_steps(rerun: Rerun, motion: Motion, j: Int[Array, ""]) -> SegmentSteps:
    """Segment j, run again from where its event left it, on to its next event.

    It takes the same steps but for rounding, by which another program differs: where a gap closes slowly, that may be
    another time or one step more. One that ends elsewhere counts as out of steps, and so does one in which the flow
    jumps: a wrong gradient must not pass.
    """
    system, stepper, start, t1, least_state = rerun
    mode, first, _ = segment(motion, j)
    events, previous = motion.events, jnp.maximum(j - 1, 0)
    t = segment_start(motion, j, start[0])
    x = jnp.where(j > 0, events.states.after[previous], start[1])
    first_step = jnp.where(j > 0, events.first_step[previous], 0)
    again = dataclasses.replace(
        motion, t=t, x=x, mode=mode, steps=empty_steps(t, x, stepper.segment_steps), first_step=first_step,
        rejected=jnp.array(0),
    )  # fmt: skip
    # A motion that ran out of steps ended within a segment, one that ended with an event has a last one of no length.
    last = (j == events.count) | ~motion.status.reached_end
    again, _ = solve_segment(system, stepper, jnp.where(last, jnp.minimum(t1, motion.t), t1), again)
    end = segment_end(motion, j)
    off = jnp.finfo(t.dtype).eps ** 0.5 * jnp.maximum(jnp.abs(end), jnp.abs(t1 - start[0]))
    steps, is_same = again.steps, jnp.abs(again.t - end) <= off
    if least_state is not None:
        is_same &= ~_flow_jumps(rerun, motion, again)
    return SegmentSteps(mode, steps, jnp.zeros_like(first), steps.count, is_same)


def _flow_jumps(rerun: Rerun, motion: Motion, again: Motion) -> Bool[Array, ""]:
    """Whether the flow jumps inside of a step of the segment that was run `again`."""
    steps = again.steps
    place = lambda k: (steps.t[k], steps.x[k])
    jumps = lambda k: jumps_inside(rerun.system, rerun.least_state, Step(again.mode, place(k), place(k + 1)))
    mean_step = (motion.t - rerun.start[0]) / jnp.maximum(motion.steps.count, 1)
    return first_jump(steps, mean_step, jumps, motion.status == Status.successful) < steps.count
