"""What the forward pass writes down, and all that the backward pass will read: nothing is derived from t later."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import FLOW_JUMP, AbstractFlatSystem, Decision, Mode
from ..numerics.tolerances import jump_length
from ..observables import EventStates
from ..status import Status
from ..xla.once import unforeseen_zero
from .doubt import Doubt


def jump_number(place):
    """The number that stands for jump time `place` where others stand for guards: -2, -3, ..."""
    return FLOW_JUMP - place


def is_jump(guard):
    """Whether a number in the place of a guard's stands for a jump time."""
    return guard <= FLOW_JUMP


def before_jump(t):
    """The last moment before a jump time: a force is evaluated there as it was before."""
    return t - jump_length(t) / 2


def after_jump(t):
    """The first moment after a jump time."""
    return t + jump_length(t) / 2


class StepRecord(eqx.Module):
    """The accepted steps: step k goes from (t[k], x[k]) to t[k+1], where x[k] already includes a jump at t[k]."""

    t: Float[Array, "step"]
    """Grid times. Behind the last one stands the end of a step that was tried and not kept, if any; then inf."""
    x: Float[Array, "step state"]
    """State at the start of each step; the last entry is the final state."""
    count: Int[Array, ""]
    """Number of accepted steps so far."""

    def append(self, t, x, keep) -> "StepRecord":
        """Write the end of a step; an entry that is not kept is overwritten by the next."""
        place = self.count + 1
        return StepRecord(write(self.t, t, place), write(self.x, x, place), self.count + keep)

    def restart(self, t, x) -> "StepRecord":
        """Replace the current time and state by those after a jump."""
        return StepRecord(write(self.t, t, self.count), write(self.x, x, self.count), self.count)


class EventRow(NamedTuple):
    """What is written down of an event; with a leading axis, of every event."""

    states: EventStates
    number: Int[Array, "*event"]
    """Which event: the number of the guard that fell through zero; that of a scheduled time, behind those of
    the guards; or `jump_number` of a jump time."""
    decision: Decision
    """The discrete outcome, with the mode after."""


class Event(NamedTuple):
    """One event, and the mode before it."""

    states: EventStates
    number: Int[Array, ""]
    decision: Decision
    mode: Mode


class EventRecord(eqx.Module):
    """Event j ends segment j. Jump times and silent events have rows among the others; `count` rows are used."""

    rows: EventRow
    """Times are inf and guards -1 beyond the last."""
    steps: Int[Array, "event"]
    """Number of accepted steps up to the event."""
    first_step: Float[Array, "event"]
    """Size of the step that was tried next after the event."""
    count: Int[Array, ""]
    """How many rows are used."""
    room: int = eqx.field(static=True)
    """How many events may be reported; rows of jump times and of silent events come beside them."""

    @property
    def states(self) -> EventStates:
        return self.rows.states

    def append(self, passes, event: EventRow, steps, first_step) -> "EventRecord":
        """Write the next event; one that does not pass is overwritten by the next."""
        put = lambda rows, entry: jax.tree.map(lambda buffer, leaf: write(buffer, leaf, self.count), rows, entry)
        return EventRecord(
            put(self.rows, event), put(self.steps, steps), put(self.first_step, first_step), self.count + passes,
            self.room,
        )  # fmt: skip


class Motion(eqx.Module):
    """The forward pass as far as it has come.

    The two records are only ever written: where the motion stands is carried beside them, because a buffer that is
    read and written in the same loop is copied whole at every turn.
    """

    begun: Bool[Array, ""]
    """Whether the initial mode has been chosen."""
    t: Float[Array, ""]
    """Where the motion stands."""
    x: Float[Array, "state"]
    """The state there."""
    mode: Mode
    """The mode there."""
    first_mode: Mode
    """The mode that it began in. Every later one is that after an event."""
    steps: StepRecord
    events: EventRecord
    last_event: Int[Array, ""]
    """Number of the last event, -1 before the first."""
    last_event_time: Float[Array, ""]
    """-inf before the first."""
    last_is_silent: Bool[Array, ""]
    """Whether the last event was silent: its place in time has no derivative that another event could share."""
    doubt: Doubt
    unreported: Int[Array, ""]
    """Jump times and silent events passed so far, which are rows of the record of events."""
    rejected: Int[Array, ""]
    """Steps that were tried and not kept (those that overshot an event among them)."""
    first_step: Float[Array, ""]
    """Size of the step to try next; 0 where the error control has to find one."""
    ended: Bool[Array, ""]
    """Whether it has ended with its last event, as it was to."""
    status: Status


def write(buffer: Array, row: Array, place: Int[Array, ""]) -> Array:
    """Write one row of a buffer. `xla.lockstep` looks for this operation."""
    row = jnp.asarray(row, buffer.dtype)[None]
    return lax.dynamic_update_slice(buffer, row, (place, *[0] * (buffer.ndim - 1)))


def empty_motion(system: AbstractFlatSystem, t0, x0, mode: Mode, max_events: int, max_steps: int, status) -> Motion:
    """A motion that stands at (t0, x0) and has room for `max_steps` steps, `max_events` events and all jump times.

    Both records have one row more than they may use, for the entry that is written and then not kept.
    """
    steps = empty_steps(t0, x0, max_steps)
    room = max_events
    jump_times = system.jump_times()
    max_events += (0 if jump_times is None else jump_times.shape[0]) + system.silent_room(max_events)
    decision = jax.eval_shape(lambda: system.decide(jnp.array(0), t0, x0, mode))
    _, emitted = jax.eval_shape(lambda decision: system.reset(decision, t0, x0), decision)
    rows = lambda tree: jax.tree.map(lambda leaf: jnp.zeros((max_events + 1, *leaf.shape), leaf.dtype), tree)
    states = EventStates(jnp.full(max_events + 1, jnp.inf, t0.dtype), rows(x0), rows(x0), rows(emitted))
    events = EventRecord(
        rows=EventRow(states, jnp.full(max_events + 1, -1), rows(decision)),
        steps=jnp.zeros(max_events + 1, int),
        first_step=jnp.zeros(max_events + 1, t0.dtype),
        count=jnp.array(0),
        room=room,
    )
    never = jnp.array(-jnp.inf, t0.dtype)
    begun, doubt, zero = jnp.array(False), Doubt.none(t0), jnp.array(0)
    return Motion(
        begun, t0, x0, mode, mode, steps, events, jnp.array(-1), never, jnp.array(False), doubt, zero, zero,
        jnp.zeros_like(t0), jnp.array(False), status,
    )  # fmt: skip


def empty_steps(t, x, max_steps: int) -> StepRecord:
    """A record that starts at (t, x). What is written beyond its room falls on the last row, and is
    counted all the same."""
    t, x = lax.optimization_barrier((t, x))  # or XLA fills a long record while it compiles, where t is a constant
    first = unforeseen_zero()
    times = write(jnp.full(max_steps + 2, jnp.inf, t.dtype), t, first)
    states = write(jnp.zeros((max_steps + 2, x.shape[0]), x.dtype), x, first)
    return StepRecord(times, states, jnp.array(0))


def segment(motion: Motion, j) -> tuple[Mode, Int[Array, ""], Int[Array, ""]]:
    """Mode, first step and one past the last step of segment j, which lies between events j - 1 and j."""
    events = motion.events
    here, previous = jnp.minimum(j, events.steps.shape[0] - 1), jnp.maximum(j - 1, 0)
    first = jnp.where(j > 0, events.steps[previous], 0)
    return segment_mode(motion, j), first, jnp.where(j < events.count, events.steps[here], motion.steps.count)


def segment_mode(motion: Motion, j) -> Mode:
    """Mode of segment j: that after event j - 1."""
    after, previous = motion.events.rows.decision.mode, jnp.maximum(j - 1, 0)
    return jax.tree.map(lambda rows, first: jnp.where(j > 0, rows[previous], first), after, motion.first_mode)


def recorded_event(motion: Motion, j) -> Event:
    """Event j, which ends segment j."""
    row = jax.tree.map(lambda rows: rows[j], motion.events.rows)
    return Event(row.states, row.number, row.decision, segment_mode(motion, j))


def segment_start(motion: Motion, j, t0) -> Float[Array, ""]:
    """When segment j began."""
    previous = jnp.maximum(j - 1, 0)
    time = motion.events.states.time[previous]
    return jnp.where(j > 0, jnp.where(is_jump(motion.events.rows.number[previous]), after_jump(time), time), t0)


def segment_end(motion: Motion, j) -> Float[Array, ""]:
    """When segment j ended."""
    events = motion.events
    place = jnp.minimum(j, events.steps.shape[0] - 1)
    time = events.states.time[place]
    time = jnp.where(is_jump(events.rows.number[place]), before_jump(time), time)
    return jnp.where(j < events.count, time, motion.t)


def first_moment(system: AbstractFlatSystem, t0) -> Float[Array, ""]:
    """t0; behind it where it is a jump time, so that the motion begins with the flow after that."""
    times = system.jump_times()
    if times is None:
        return t0
    starts_there = jnp.any(times.astype(t0.dtype) == t0)
    return t0 + lax.stop_gradient(jnp.where(starts_there, after_jump(t0) - t0, 0))


def last_moment(motion: Motion, t1) -> Float[Array, ""]:
    """t1; behind it where a jump time there was passed, so that the flow is that after it."""
    return t1 + lax.stop_gradient(jnp.maximum(motion.t - t1, 0))


def where_reached(motion: Motion, by_t1: Array) -> Array:
    """A derivative by t1, which is 0 where the motion broke off: the instant at which it did is held fixed."""
    return jnp.where(motion.status.reached_end, by_t1, 0)


def order_of_events(motion: Motion) -> Int[Array, "event"]:
    """Rows of the record that are reported, in their order."""
    events = motion.events
    hidden = is_jump(events.rows.number) | events.rows.decision.silent
    sort = lambda: jnp.argsort(hidden, stable=True)[: events.room]
    return lax.cond(motion.unreported > 0, sort, lambda: jnp.arange(events.room))  # to sort takes longer than to ask
