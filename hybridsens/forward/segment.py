"""One smooth piece of a motion: a single Diffrax solve that ends on an event or at the end of the horizon."""

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..hybrid import AbstractHybridSystem
from ..short import any_of
from ..status import Status
from .landing import LandingController, LandingState, first_to_fall, guards_at_start
from .record import Motion
from .solver import TERM


class Stepper(eqx.Module):
    """How steps are taken: the method and its error control."""

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractAdaptiveStepSizeController
    max_steps: int = eqx.field(static=True)
    """How many steps may be tried in all."""
    segment_steps: int = eqx.field(static=True)
    """How many steps a segment may have."""


class SegmentEnd(eqx.Module):
    """Why a segment ended."""

    event: Bool[Array, ""]
    """Whether a guard fell through zero."""
    guard: Int[Array, ""]
    """Which one; -1 where the motion has not begun, meaningless without an event."""


def solve_segment(system: AbstractHybridSystem, stepper: Stepper, t1, motion: Motion) -> tuple[Motion, SegmentEnd]:
    """Integrate from where the motion stands until the first event or t1; its beginning is an event too."""
    start = guards_at_start(system, motion.t, motion.x, motion.mode)
    at_once = any_of(start.fired) | ~motion.begun
    solution = diffrax.diffeqsolve(
        TERM,
        stepper.solver,
        motion.t,
        jnp.where(at_once, motion.t, t1),
        None,
        motion.x,
        args=(system, motion.mode),
        stepsize_controller=LandingController(
            stepper.controller, motion.first_step, t1, motion.steps, motion.rejected, start, stepper.max_steps,
            stepper.segment_steps,
        ),
        saveat=diffrax.SaveAt(t1=True, controller_state=True),
        adjoint=diffrax.ForwardMode(),
        max_steps=None,
        throw=False,
    )
    state, ts, ys = solution.controller_state, solution.ts, solution.ys
    assert isinstance(state, LandingState) and ts is not None and ys is not None
    landed = solution.result == diffrax.RESULTS.event_occurred
    guard = jnp.where(at_once, first_to_fall(start.fired, start.guard, start.rate), state.fired)
    guard = jnp.where(motion.begun, guard, -1)
    first_step = jnp.where(motion.begun, state.free_step, motion.first_step)  # to be found in the mode then chosen
    motion = Motion(
        motion.begun, ts[0], ys[0], motion.mode, state.record, motion.events, motion.last_guard, motion.last_event,
        motion.grazing | state.grazing, state.rejected, first_step, _status(solution.result, state.finite),
    )  # fmt: skip
    return motion, SegmentEnd(at_once | landed, guard)


def _status(result, finite) -> Status:
    R = diffrax.RESULTS
    failure = Status.where(finite, Status.step_size_underflow, Status.non_finite)
    failure = Status.where(result == R.max_steps_reached, Status.max_steps_reached, failure)
    ended = (result == R.successful) | (result == R.event_occurred)
    return Status.where(ended, Status.running, failure)
