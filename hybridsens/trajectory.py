"""What a simulation returns. Everything with a floating point type here can be differentiated."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.core
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .mechanics.mode import EventKind
from .mechanics.scene import State
from .status import Status


class Steps(NamedTuple):
    """How much work the motion took."""

    accepted: Int[Array, "*batch"]
    rejected: Int[Array, "*batch"]
    """Steps tried and not kept, for their error or because they overshot an event."""


class Events(eqx.Module):
    """The events in the order of time, padded to `max_events`. Rows beyond `count` have time inf, and zeros
    elsewhere."""

    time: Float[Array, "*batch event"]
    """When [s]."""
    kind: Int[Array, "*batch event"]
    """An `EventKind`: impact 0, capture 1, release 2; -1 in padding."""
    contact: Int[Array, "*batch event"]
    """Which gap closed or opened; -1 in padding."""
    before: State
    """States just before, (event, dof)."""
    after: State
    """States just after, (event, dof)."""
    impulse: Float[Array, "*batch event contact"]
    """Impulses of all contacts that took part [N s]; zero at a release. Where several contacts settle together at the
    end of a cascade, single ones may be negative, by 1e-5 of the largest of the cascade."""
    closing_speed: Float[Array, "*batch event"]
    """-Phi' of the contact just before: how far from grazing (0) an impact was; 0 at a release [m/s]."""
    count: Int[Array, "*batch"]
    """How many events there were."""


class Trajectory(eqx.Module):
    """A motion of a scene from t0 to t1."""

    ts: Float[Array, "*batch sample"] | None
    """Times asked for."""
    q: Float[Array, "*batch sample dof"] | None
    """Configurations there; just after the event where a time is an event's."""
    v: Float[Array, "*batch sample dof"] | None
    """Velocities there."""
    final: State
    """State at t1 (or where the motion ended, see `status`)."""
    cost: Any
    """Integral of the running cost, with its structure; None without one."""
    events: Events
    mode: Bool[Array, "*batch contact"]
    """Contacts held closed at the end."""
    status: Status
    """`Status.successful`, or what went wrong."""
    steps: Steps

    def __str__(self) -> str:
        if isinstance(self.final.q, jax.core.Tracer):
            return f"Trajectory(traced, final q of shape {self.final.q.shape})"
        if np.ndim(self.events.count) > 0:
            return f"Trajectory(batch of {np.shape(self.events.count)}; index it to see one)"
        return "\n".join([*self._head(), *_event_table(self.events), f"final: {_state(self.final)}"])

    def _head(self):
        message = Status[self.status] or "successful"
        accepted, rejected = int(self.steps.accepted), int(self.steps.rejected)
        yield f"status: {message}"
        yield f"steps: {accepted} accepted, {rejected} rejected; events: {int(self.events.count)}"
        if self.cost is not None:
            yield f"cost: {self.cost}"


class SimulationError(RuntimeError):
    """A motion that did not reach its end, with `throw=True`."""


def _event_table(events: Events):
    count = int(events.count)
    if count == 0:
        return
    yield f"{'event':>5} {'time':>14} {'kind':>8} {'contact':>7} {'closing speed':>14} {'impulse':>12}  state after"
    shown = list(range(count)) if count <= 20 else [*range(10), None, *range(count - 9, count)]
    for j in shown:
        if j is None:
            yield f"{'...':>5} ({count - 19} more)"
            continue
        contact = int(events.contact[j])
        kind = EventKind(int(events.kind[j])).name.lower()
        after = _state(State(events.after.q[j], events.after.v[j]))
        yield (
            f"{j:>5} {float(events.time[j]):>14.9f} {kind:>8} {contact:>7} {float(events.closing_speed[j]):>14.6g} "
            f"{float(events.impulse[j, contact]):>12.6g}  {after}"
        )


def _state(state: State) -> str:
    with np.printoptions(precision=6, suppress=False):
        return f"q = {np.asarray(state.q)}, v = {np.asarray(state.v)}"
