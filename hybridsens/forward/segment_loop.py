"""The segment loop: solve a segment, and if it ended in an event decide, jump, write it down, go on."""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..flat_system import FLOW_JUMP, START, AbstractFlatSystem, Decision
from ..numerics.tolerances import MOST_RELAXED, time_resolution
from ..observables import EventMarks, EventStates
from ..status import Status
from .doubt import Doubt
from .past_jump import past_jump
from .record import EventRow, Motion, after_jump, is_jump
from .segment import SegmentEnd, guard_count, solve_segment
from .solver import Stepper


class Transition(NamedTuple):
    """An event carried out."""

    decision: Decision
    after: Float[Array, "state"]
    emitted: Any


def run_segments(system: AbstractFlatSystem, stepper: Stepper, t1, motion: Motion) -> Motion:
    """Carry a motion on to t1, through every event, in one compiled loop; in one solve where no event can come."""
    scheduled = system.scheduled_times(motion.x, motion.mode)
    if guard_count(system, motion) == 0 and system.jump_times() is None and scheduled is None:
        return _run_freely(system, stepper, t1, motion)

    def body(motion):
        motion, end = solve_segment(system, stepper, t1, motion)
        return pass_event(system, motion, end)

    motion = lax.while_loop(_goes_on, body, motion)
    stuck = motion.status == Status.step_size_underflow
    why = lax.cond(stuck, lambda: system.stuck(motion.t, motion.x, motion.mode), lambda: motion.status)
    return dataclasses.replace(motion, status=why)


def _goes_on(motion: Motion):
    """Whether the motion is running. The second condition always holds, since a motion without room for its event ends.

    Without it one carried value would end the loop: then XLA interprets the body to find how many turns it takes, again
    in every pass of the compiler."""
    return (motion.status == Status.running) & (motion.events.count < motion.events.steps.shape[0])


def _run_freely(system: AbstractFlatSystem, stepper: Stepper, t1, motion: Motion) -> Motion:
    """A motion without any event, in one solve, which has no length where the motion must not start. Nothing holds its
    state, so nothing projects it."""
    begins = system.decide(jnp.array(START), motion.t, motion.x, motion.mode)
    start = Status.where(motion.status == Status.running, begins.status, motion.status)
    motion = dataclasses.replace(motion, begun=jnp.array(True), status=start)
    motion, _ = solve_segment(system, stepper, jnp.where(start == Status.running, t1, motion.t), motion)
    ended = Status.where(motion.status == Status.running, Status.successful, motion.status)
    return dataclasses.replace(motion, status=Status.where(start == Status.running, ended, start))


def pass_event(system: AbstractFlatSystem, motion: Motion, end: SegmentEnd) -> Motion:
    """Carry out the event that ended a segment: decide what it is, reset the state, write it down. Without an event the
    motion has ended; with one it has where the system says so.

    The first event is the beginning: it chooses the mode, puts the state on the constraints of that mode, and is not
    `recorded`. A jump time chooses the mode anew, and the state moves on while the clock passes it. Where there is no
    room for an event, or where it repeats, it is not carried out: all stays as before, and the status tells why."""
    t, before, events = end.time, motion.x, motion.events
    at_jump_time = is_jump(end.event)
    hidden = at_jump_time | system.is_silent(end.event, motion.mode)
    full = ~hidden & (events.count - motion.unreported >= events.room)
    repeats = _repeats(system, motion, end)
    carried_out = end.is_event & ~full & ~repeats
    recorded = carried_out & motion.begun
    transition = lambda: _transition(system, motion, end, at_jump_time)
    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(transition))
    done = lax.cond(carried_out, transition, lambda: nothing)
    after = jnp.where(carried_out, done.after, before)
    t_after = jnp.where(carried_out & at_jump_time, after_jump(t), t)
    # A step of no length would never grow.
    first_step_bound = jnp.maximum(done.decision.first_step_bound, time_resolution(t, 0))
    first_step = jnp.where(carried_out, jnp.minimum(motion.first_step, first_step_bound), motion.first_step)
    # The row is always written and counts only if `recorded`: a conditional would copy the whole buffer.
    states = EventStates(jnp.where(recorded, t, jnp.inf), before, after, done.emitted)
    event = EventRow(states, jnp.where(recorded, end.event, -1), done.decision)
    ends = recorded & ~hidden & system.ends_with(states, _marks(motion, event))
    doubt = _doubt(motion, end, done.decision, recorded)
    events = events.append(recorded, event, motion.steps.count, first_step)
    mode = jax.tree.map(lambda new, old: jnp.where(carried_out, new, old), done.decision.mode, motion.mode)
    decided = Status.where(carried_out, done.decision.status, Status.running)
    why_not = _why_not_further(end, full, repeats, decided)
    return Motion(
        begun=jnp.array(True),
        t=t_after,
        x=after,
        mode=mode,
        first_mode=jax.tree.map(lambda first, new: jnp.where(motion.begun, first, new), motion.first_mode, mode),
        steps=motion.steps.restart(t_after, after),
        events=events,
        last_event=jnp.where(carried_out, end.event, motion.last_event),
        last_event_time=jnp.where(recorded, t, motion.last_event_time),
        last_is_silent=jnp.where(carried_out, jnp.asarray(done.decision.silent), motion.last_is_silent),
        doubt=doubt,
        unreported=motion.unreported + (recorded & hidden),
        rejected=motion.rejected,
        first_step=first_step,
        ended=ends,
        status=_status(motion, doubt, end.is_event & ~ends, why_not),
    )


def _repeats(system: AbstractFlatSystem, motion: Motion, end: SegmentEnd) -> Bool[Array, ""]:
    """Whether the last event comes once more, at the same instant: it would do so for ever.

    Two kinds may come once more: a scheduled time that its event moved, and a guard that its event put below 0."""
    is_last = motion.begun & (end.event == motion.last_event)
    may_repeat = (end.event >= guard_count(system, motion)) | system.fires_at_once(end.event, motion.mode)
    return is_last & ~may_repeat & (end.time - motion.last_event_time <= time_resolution(end.time, 1))


def _transition(system: AbstractFlatSystem, motion: Motion, end: SegmentEnd, at_jump_time) -> Transition:
    """Carry out an event: decide, and reset the state; project it at the beginning, let it go on past a jump time."""
    t, before = end.time, motion.x
    at = jnp.where(at_jump_time, after_jump(t), t)
    event = jnp.maximum(end.event, FLOW_JUMP)  # one number stands for every jump time
    decision = system.decide(event, at, before, motion.mode)
    if decision.at_once is not False:  # in a system whose events may come with the one before
        # A guard that jumps below zero at the instant of that event moves with it, for that event tells where.
        same_instant = (t - motion.last_event_time <= time_resolution(t, MOST_RELAXED)) & ~motion.last_is_silent
        decision = dataclasses.replace(decision, at_once=decision.at_once | (end.guard_jumped & same_instant))
    reset_x, emitted = system.reset(decision, t, before)
    at_event = lambda: reset_x
    if system.jump_times() is not None:
        past = lambda: past_jump(system, t, before, (motion.mode, decision.mode))
        at_event = lambda: lax.cond(at_jump_time, past, lambda: reset_x)
    after = lax.cond(motion.begun, at_event, lambda: system.project(t, before, decision.mode))
    return Transition(decision, after, emitted)


def _doubt(motion: Motion, end: SegmentEnd, decision: Decision, recorded) -> Doubt:
    """Why derivatives are not to be trusted, this event included where it is `recorded`."""
    # Where a guard that was below zero jumps above it, nothing happens, so that no derivative asks for that place.
    jumps = end.guard_jumped & jnp.logical_not(decision.at_once) & jnp.logical_not(decision.silent)
    doubt = motion.doubt.also(recorded & jumps, Status.guard_jumps, end.time)
    return doubt.also(recorded & decision.grazing, Status.grazing, end.time)


def _why_not_further(end: SegmentEnd, full, repeats, decided: Status) -> Status:
    """`Status.running`, or why the motion must not go on from an event. Later lines override earlier ones."""
    why = Status.where(end.is_event & repeats, Status.event_repeats, decided)
    return Status.where(end.is_event & full, Status.max_events_reached, why)


def _status(motion: Motion, doubt: Doubt, goes_on, why_not: Status) -> Status:
    """What is said of the motion after a segment and its event: it goes on, or has ended as it should, or has not."""
    whole = Status.where(doubt.why == Status.running, Status.successful, doubt.why)
    ended = Status.where(motion.status == Status.running, whole, motion.status)
    status = Status.where(goes_on, motion.status, ended)
    return Status.where(why_not == Status.running, status, why_not)


def _marks(motion: Motion, event: EventRow) -> EventMarks:
    """What is discrete about the next event."""
    decision, count = event.decision, motion.events.count - motion.unreported + 1
    return EventMarks(event.number, decision.kind, jnp.asarray(decision.order_matters), decision.mode, count)
