"""What is decided at an event of a hybrid system, beside the mode that its transition gives."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .delays import overflowed
from .flat_system import Decision
from .status import Status
from .watch import Seen, WatchedMode


class EventDetail(NamedTuple):
    """What the reset of an event needs to know of it."""

    event: Array
    mode: Any
    """The mode before."""


class Shown(NamedTuple):
    """What the system shows at one instant."""

    guards: Seen
    times: Float[Array, "time"]
    """Scheduled times."""
    times_rates: Float[Array, "time"]
    """Their rates along the flow, which must be 0."""


def decision_of(
    watched: WatchedMode,
    detail: EventDetail,
    shown: Shown,
    moves_by_itself: Array,
    at_once: Array | bool = False,
    silent: Array | bool = False,
) -> Decision:
    """A transition, after which steps may be as long as before. No scheduled time may move by itself, before the event
    or after it."""
    never = jnp.full((), jnp.inf, watched.watch.size.dtype)
    moves = moves_by_itself | jnp.any(watched.expected & (shown.times_rates != 0))
    status = Status.where(moves, Status.scheduled_time_moves, Status.running)
    status = Status.where(overflowed(watched.given), Status.queue_full, status)
    at_once, silent = jnp.asarray(at_once), jnp.asarray(silent)
    kind = jnp.array(0)
    return Decision(watched, kind, detail, status=status, first_step_bound=never, at_once=at_once, silent=silent)
