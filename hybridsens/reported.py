"""What is reported of a motion: its record without jump times and silent events, cut to the room asked for."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

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
    ended: Bool[Array, ""]
    """Whether the motion has ended with its last event, as it was to."""
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
    number, kind = (jnp.where(happened, cut(rows), -1) for rows in (events.number, events.decision.kind))
    marks = EventMarks(number, kind, cut(events.decision.order_matters), cut(events.decision.mode), count)
    return Reported(
        Observables(motion.x, samples, states, jnp.zeros_like(motion.t)), marks, motion.mode, motion.ended,
        motion.status, motion.t, motion.doubt.time, motion.steps.count, motion.rejected,
    )  # fmt: skip


def end_of(reported: Reported, status: Status, t1: Array, may_end_early: bool) -> tuple[Array, Array]:
    """State and time of the end: at t1; of an event that the motion was to end with, with which they move; or where it
    broke off, an instant that derivatives hold fixed."""
    final, events = reported.observed.final, reported.observed.events
    end_time = jnp.where(status.reached_end, t1, lax.stop_gradient(reported.end_time))
    if not may_end_early:
        return final, end_time
    last, ended = jnp.maximum(reported.marks.count - 1, 0), reported.ended & status.reached_end
    return jnp.where(ended, events.after[last], final), jnp.where(ended, events.time[last], end_time)


def where_in_doubt(status: Status, doubt_time: Array) -> Array:
    """When a motion came into doubt; nan for one that is not, or that broke off later."""
    return lax.stop_gradient(jnp.where(status.in_doubt, doubt_time, jnp.nan))


def in_rows_recorded(motion: Motion, room: int, cotangent: EventStates) -> EventStates:
    """Cotangents of the rows of the record from those of the events reported."""
    rows = motion.events.steps.shape[0]
    if rows - 1 == room:
        return cotangent
    order = order_of_events(motion)
    return jax.tree.map(lambda leaf: jnp.zeros((rows, *leaf.shape[1:]), leaf.dtype).at[order].set(leaf), cotangent)
