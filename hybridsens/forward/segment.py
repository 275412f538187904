"""One smooth piece of a motion: a single Diffrax solve that ends on an event or at the end of the horizon."""

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..hybrid import AbstractHybridSystem
from .landing import LandingController, LandingState, time_resolution
from .record import Motion
from .solver import TERM
from .status import Status


class Stepper(eqx.Module):
    """How steps are taken: the method and its error control."""

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractAdaptiveStepSizeController


class SegmentEnd(eqx.Module):
    """Why a segment ended."""

    event: Bool[Array, ""]
    """Whether a guard fell through zero."""
    guard: Int[Array, ""]
    """Which one; meaningless without an event."""
    rate: Float[Array, ""]
    """Its rate h' there."""


def solve_segment(system: AbstractHybridSystem, stepper: Stepper, t1, motion: Motion) -> tuple[Motion, SegmentEnd]:
    """Integrate from where the motion stands until the first event or t1."""
    already, _, _ = fallen_guard(system, motion.t, motion.x, motion.mode)
    controller = LandingController(stepper.controller, motion.first_step, t1, motion.steps, motion.rejected)
    solution = diffrax.diffeqsolve(
        TERM,
        stepper.solver,
        motion.t,
        jnp.where(already, motion.t, t1),
        None,
        motion.x,
        args=(system, motion.mode),
        stepsize_controller=controller,
        saveat=diffrax.SaveAt(t1=True, controller_state=True),
        adjoint=diffrax.ForwardMode(),
        max_steps=None,
        throw=False,
    )
    state: LandingState = solution.controller_state
    t, x = solution.ts[0], solution.ys[0]
    landed = solution.result == diffrax.RESULTS.event_occurred
    _, guard, rate = fallen_guard(system, t, x, motion.mode)
    status = _status(solution.result, system, t, x, motion.mode)
    motion = Motion(
        t, x, motion.mode, state.record, motion.events, motion.last_guard, motion.last_event,
        state.rejected, state.free_step, status,
    )  # fmt: skip
    return motion, SegmentEnd(already | landed, guard, rate)


def fallen_guard(system: AbstractHybridSystem, t, x, mode):
    """Whether a guard is at or below zero and falling; which one fell first, and its rate."""
    guards, rates = system.guards_and_rates(t, x, mode)
    if guards.shape[0] == 0:
        return jnp.array(False), jnp.array(-1), jnp.zeros_like(t)
    falling = rates < 0
    lateness = jnp.where(falling, guards / jnp.where(falling, rates, 1), -jnp.inf)  # time since it passed zero
    first = jnp.argmax(lateness)
    return lateness[first] >= -time_resolution(t, 0), first, rates[first]


def _status(result, system, t, x, mode) -> Status:
    R = diffrax.RESULTS
    finite = jnp.all(jnp.isfinite(x)) & jnp.all(jnp.isfinite(system.flow(t, x, mode)))
    failure = Status.where(finite, Status.step_size_underflow, Status.non_finite)
    failure = Status.where(result == R.max_steps_reached, Status.max_steps_reached, failure)
    ended = (result == R.successful) | (result == R.event_occurred)
    return Status.where(ended, Status.running, failure)
