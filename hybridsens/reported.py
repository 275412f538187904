"""What is reported of a motion: its record without jump times and silent events, cut to the room asked for."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .flat_system import Mode
from .forward.record import Motion, order_of_events
from .observables import EventMarks, EventStates, Observables
from .status import Status


class Reported(NamedTuple):
    """Everything that is reported of a motion. Rows of events beyond `count` are padding."""

    observed: Observables
    """What it can be differentiated by."""
    marks: EventMarks
    """What is discrete about the events."""
    mode: Mode
    status: Status
    end_time: Float[Array, ""]
    """When the motion ended: t1, or where it broke off, which is held fixed."""
    doubt_time: Float[Array, ""]
    """When that happened which puts the derivatives of a motion that reached its end in doubt; nan for another."""
    accepted: Int[Array, ""]
    rejected: Int[Array, ""]


def report(motion: Motion, samples: Float[Array, "sample state"] | None, room: int) -> Reported:
    """What is reported of a motion and its samples, in so many rows of events."""
    events, count = motion.events.rows, motion.events.count - motion.unreported
    happened = jnp.arange(room) < count
    if motion.events.steps.shape[0] - 1 == room:
        picked = lambda leaf: leaf[:room]
    else:  # jump times and silent events have rows of their own
        order = order_of_events(motion)
        picked = lambda leaf: leaf[order]
    # The row after the last event holds where the motion ended.
    rows = lambda leaf: happened.reshape(-1, *[1] * (leaf.ndim - 1))
    blank = lambda leaf: jnp.where(rows(leaf), picked(leaf), jnp.zeros((), leaf.dtype))
    cut = lambda rows: jax.tree.map(blank, rows)
    states = cut(events.states)
    states = states._replace(time=jnp.where(happened, states.time, jnp.inf))
    number, kind = (jnp.where(happened, cut(rows), -1) for rows in (events.guard, events.decision.kind))
    marks = EventMarks(number, kind, cut(events.decision.order_matters), cut(events.decision.mode), count)
    return Reported(
        Observables(motion.x, samples, states, jnp.zeros_like(motion.t)), marks, motion.mode, motion.status, motion.t,
        motion.doubt.time, motion.steps.count, motion.rejected,
    )  # fmt: skip


def ended_with_event(reported: Reported, t1: Array) -> Reported:
    """What is reported of a motion that was to end with an event: if it did, the time and the state of its end are
    those of that event, and move with it."""
    observed, events = reported.observed, reported.observed.events
    last = jnp.maximum(reported.marks.count - 1, 0)
    ended = reported.status.reached_end & (reported.end_time < t1)
    at_event = lambda rows, otherwise: jnp.where(ended, rows[last], otherwise)
    observed = observed._replace(final=at_event(events.after, observed.final))
    return reported._replace(observed=observed, end_time=at_event(events.time, reported.end_time))


def in_rows_recorded(motion: Motion, room: int, cotangent: EventStates) -> EventStates:
    """Cotangents of the rows of the record from those of the events reported."""
    rows = motion.events.steps.shape[0]
    if rows - 1 == room:
        return cotangent
    order = order_of_events(motion)
    return jax.tree.map(lambda leaf: jnp.zeros((rows, *leaf.shape[1:]), leaf.dtype).at[order].set(leaf), cotangent)
