"""What is reported of a motion: its record without jump times and silent events, cut to the room asked for."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .flat_system import Mode
from .forward.record import Motion, order_of_events
from .status import Status


class Reported(NamedTuple):
    """Everything that is reported of a motion. Rows of events beyond `count` are padding."""

    final: Float[Array, "state"]
    samples: Float[Array, "sample state"] | None
    time: Float[Array, "event"]
    before: Float[Array, "event state"]
    after: Float[Array, "event state"]
    emitted: Any
    guard: Int[Array, "event"]
    kind: Int[Array, "event"]
    order_matters: Bool[Array, "event"]
    count: Int[Array, ""]
    mode_after: Mode
    """Modes that the events led to."""
    mode: Mode
    status: Status
    accepted: Int[Array, ""]
    rejected: Int[Array, ""]


def report(motion: Motion, samples: Float[Array, "sample state"] | None, room: int) -> Reported:
    events = motion.events
    count = events.count - motion.unreported
    if events.time.shape[0] - 1 == room:
        cut = lambda rows: jax.tree.map(lambda leaf: leaf[:room], rows)
    else:  # jump times and silent events have rows of their own
        order = order_of_events(motion)
        rows = lambda leaf: (jnp.arange(room) < count).reshape(-1, *[1] * (leaf.ndim - 1))
        blank = lambda leaf: jnp.where(rows(leaf), leaf[order], jnp.zeros((), leaf.dtype))
        cut = lambda rows: jax.tree.map(blank, rows)
    happened = jnp.arange(room) < count
    time, guard = jnp.where(happened, cut(events.time), jnp.inf), jnp.where(happened, cut(events.guard), -1)
    return Reported(
        motion.x, samples, time, cut(events.before), cut(events.after), cut(events.emitted),
        guard, cut(events.decision.kind), cut(events.decision.order_matters), count,
        cut(events.decision.mode), motion.mode, motion.status, motion.steps.count, motion.rejected,
    )  # fmt: skip


def event_rows(motion: Motion, room: int, reported_bar):
    """Cotangents of the rows of the record from those of the events reported."""
    rows = motion.events.time.shape[0]
    if rows - 1 == room:
        return reported_bar
    order = order_of_events(motion)
    return jax.tree.map(lambda bar: jnp.zeros((rows, *bar.shape[1:]), bar.dtype).at[order].set(bar), reported_bar)
