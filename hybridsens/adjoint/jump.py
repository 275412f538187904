"""Variations across one event: what (T5)-(T10) say, without their algebra.

Seen from a fixed time t_k, a varied motion reaches the guard at t_k + dt. So the map from the state before to the
state after, both at t_k, is: move on by dt with the flow before, reset, move back by dt with the flow after. Its JVP
is the saltation matrix, its VJP the adjoint jump condition, and what is reported of the event gets its derivative from
the same lines.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..hybrid import AbstractHybridSystem, Decision, Mode


class RecordedEvent(NamedTuple):
    """One row of the event record: constants of the jump."""

    time: Float[Array, ""]
    guard: Array
    before: Float[Array, "state"]
    after: Float[Array, "state"]
    decision: Decision
    mode: Mode


class Crossing(NamedTuple):
    """Rates at an event, held constant while the jump is differentiated."""

    flow_before: Float[Array, "state"]
    flow_after: Float[Array, "state"]
    guard_rate: Float[Array, ""]


class Jump(NamedTuple):
    """What an event passes on, and what is reported of it."""

    state: Float[Array, "state"]
    """State after, as seen from the fixed time of the recorded event."""
    time: Float[Array, ""]
    before: Float[Array, "state"]
    after: Float[Array, "state"]
    emitted: Any


def crossing(system: AbstractHybridSystem, event: RecordedEvent) -> Crossing:
    """Flows on both sides, each in its own mode, and the rate h' = h_t + h_x f- of the guard."""
    flow_before = system.flow(event.time, event.before, event.mode)
    flow_after = system.flow(event.time, event.after, event.decision.mode)
    guard = lambda t, x: _entry(system.guards(t, x, event.mode), event.guard)
    _, rate = jax.jvp(guard, (event.time, event.before), (jnp.ones_like(event.time), flow_before))
    return Crossing(flow_before, flow_after, rate)


def jump(system: AbstractHybridSystem, event: RecordedEvent, rates: Crossing, before: Float[Array, "state"]) -> Jump:
    """From the state before to the state after an event, at its fixed recorded time.

    dt = -h / h'  (T5), zero in value;  x+ = R(t + dt, x- + f- dt) - f+ dt  (T6). Differentiate with respect to
    `system` and `before`; `event` and `rates` are constants.
    """
    guard = _entry(system.guards(event.time, before, event.mode), event.guard)
    dt = -guard / rates.guard_rate
    t = event.time + dt
    at_guard = before + rates.flow_before * dt
    after, emitted = system.reset(event.decision, t, at_guard)
    return Jump(after - rates.flow_after * dt, t, at_guard, after, emitted)


def event_row(record, place) -> RecordedEvent:
    """One event of an EventRecord."""
    return RecordedEvent(*(jax.tree.map(lambda leaf: leaf[place], getattr(record, f)) for f in RecordedEvent._fields))


def _entry(guards: Float[Array, "guard"], place) -> Float[Array, ""]:
    """One guard, by a sum: a system without guards traces through here too, and an index would have no bounds."""
    return jnp.sum(jnp.where(jnp.arange(guards.shape[0]) == place, guards, 0))
