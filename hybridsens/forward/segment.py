"""One smooth piece of a motion: a single Diffrax solve that ends on an event or at the end of the horizon."""

import dataclasses
from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import START, AbstractFlatSystem
from ..status import Status
from .clip_floor import short_clip_floor
from .event_location import CRAWL, EventLocator, LocatorState
from .guards import first_to_fall, guards_at_start
from .record import Motion, before_jump, jump_number
from .solver import TERM, Stepper


class SegmentEnd(eqx.Module):
    """Why a segment ended."""

    is_event: Bool[Array, ""]
    """Whether a guard fell through zero, or a declared time was reached."""
    event: Int[Array, ""]
    """Which one: a guard or a scheduled time, or `jump_number(j)` for jump time j; `START` where the motion has not
    begun, meaningless without an event."""
    time: Float[Array, ""]
    """When: where the motion stands, or the declared time itself."""
    guard_jumped: Bool[Array, ""]
    """Whether the guard has jumped below zero, without falling."""


def solve_segment(system: AbstractFlatSystem, stepper: Stepper, t1, motion: Motion) -> tuple[Motion, SegmentEnd]:
    """Integrate from where the motion stands until the first event, the next jump time or scheduled time, or t1.

    The beginning of the motion counts as an event: the first segment ends where it starts."""
    known = next_known(system, motion, t1)
    stop = jnp.minimum(known.stop, t1)
    start = guards_at_start(system, motion.t, motion.x, motion.mode)
    ends_at_start = jnp.any(start.triggered) | ~motion.begun
    controller = EventLocator(
        stepper.controller, motion.first_step, stop, motion.steps, motion.rejected, start,
        stepper.max_steps, stepper.segment_steps,
    )  # fmt: skip
    with short_clip_floor():
        solution = diffrax.diffeqsolve(
            TERM,
            stepper.solver,
            motion.t,
            jnp.where(ends_at_start, motion.t, jnp.maximum(stop, motion.t)),
            None,
            motion.x,
            args=(system, motion.mode),
            stepsize_controller=controller,
            saveat=diffrax.SaveAt(t1=True, controller_state=True),
            adjoint=diffrax.ForwardMode(),
            max_steps=None,
            throw=False,
        )
    state, ts, ys = solution.controller_state, solution.ts, solution.ys
    assert isinstance(state, LocatorState) and ts is not None and ys is not None
    landed = solution.result == diffrax.RESULTS.event_occurred
    guard = jnp.where(ends_at_start, first_to_fall(start.triggered, start.guard, start.rate)[0], state.landed_on)
    guard = jnp.where(motion.begun, guard, START)
    motion = dataclasses.replace(
        motion,
        t=ts[0],
        x=ys[0],
        steps=state.record,
        doubt=motion.doubt.also(jnp.isfinite(state.grazed), Status.grazing, state.grazed),
        rejected=state.rejected,
        # At the beginning none is known yet (0): the error control finds one in the mode that is chosen there.
        first_step=jnp.where(motion.begun, state.free_step, motion.first_step),
        status=Status.where(jnp.isnan(known.time), Status.non_finite, _status(solution.result, state)),
    )
    on_guard = ends_at_start | landed
    at_known_time = ~on_guard & (motion.status == Status.running) & jnp.isfinite(known.stop)
    time = jnp.where(at_known_time, known.time, motion.t)
    event = jnp.where(at_known_time, known.event, guard)
    below = jnp.any(start.guard_jumped & (jnp.arange(start.guard.shape[0]) == guard))
    guard_jumped = on_guard & jnp.where(ends_at_start, below, state.guard_jumped)
    return motion, SegmentEnd(on_guard | at_known_time, event, time, guard_jumped)


class KnownTime(NamedTuple):
    """The next event whose time is known; inf where there is none before the end of the horizon."""

    time: Float[Array, ""]
    stop: Float[Array, ""]
    """Where the step before it ends."""
    event: Int[Array, ""]


def next_known(system: AbstractFlatSystem, motion: Motion, t1) -> KnownTime:
    """The next jump time or scheduled time. Of two at one instant the jump time comes first."""
    jump, scheduled = _next_jump(system, motion.t, t1), _next_scheduled(system, motion, t1)
    if jump is None or scheduled is None:
        never = jnp.full_like(motion.t, jnp.inf)
        return jump or scheduled or KnownTime(never, never, jnp.array(-1))
    return jax.tree.map(lambda one, other: jnp.where(jump.stop <= scheduled.time, one, other), jump, scheduled)


def _next_jump(system: AbstractFlatSystem, t, t1) -> KnownTime | None:
    """The first jump time after t; one at t1 is passed too. The clock stands behind the one that was passed last, which
    is not found again."""
    times = system.jump_times()
    if times is None or times.shape[0] == 0:
        return None
    later = jnp.where((times > t) & (times <= t1), times, jnp.inf)
    first = jnp.argmin(later)
    time = later[first].astype(t.dtype)
    stop = jnp.where(jnp.isfinite(time), before_jump(time), jnp.inf)  # there is no moment before inf
    return _unless_unknown(times, t, KnownTime(time, stop, jump_number(first)))


def _next_scheduled(system: AbstractFlatSystem, motion: Motion, t1) -> KnownTime | None:
    """The first scheduled time that is still to come, also if it is now."""
    times = system.scheduled_times(motion.x, motion.mode)
    if times is None:
        return None
    still = jnp.where(motion.begun & system.expected(motion.mode) & (times <= t1), times, jnp.inf)
    first = jnp.argmin(still)
    time = jnp.maximum(still[first], motion.t)  # one that an event has moved into the past comes at once
    return _unless_unknown(times, motion.t, KnownTime(time, time, guard_count(system, motion) + first))


def _unless_unknown(times, now, known: KnownTime) -> KnownTime:
    """`known`; where one of `times` is nan, its time is nan and the solve stops here (`non_finite`). Else that event
    would never come, in silence."""
    unknown = jnp.any(jnp.isnan(times))
    return KnownTime(jnp.where(unknown, jnp.nan, known.time), jnp.where(unknown, now, known.stop), known.event)


def guard_count(system: AbstractFlatSystem, motion: Motion) -> int:
    """How many guards there are: scheduled times are numbered after them."""
    return jax.eval_shape(system.guards, motion.t, motion.x, motion.mode).shape[0]


def _status(result, state: LocatorState) -> Status:
    R = diffrax.RESULTS
    # A guard that an event left below zero by rounding, and that does not come above it before it falls again.
    too_slow = state.crawled >= CRAWL
    failure = Status.where(too_slow, Status.event_repeats, Status.step_size_underflow)
    failure = Status.where(state.finite, failure, Status.non_finite)
    failure = Status.where(result == R.max_steps_reached, Status.max_steps_reached, failure)
    ended = (result == R.successful) | (result == R.event_occurred)
    return Status.where(ended, Status.running, failure)
