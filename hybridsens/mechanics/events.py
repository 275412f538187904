"""The events of a motion of a scene."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..export.trajectory import events_frame
from ..numerics.event_times import first_times, sequence_number
from ..observables import EventMarks, EventStates
from .mode import EventKind
from .scene import AbstractScene, State


class Events(eqx.Module):
    """The events in the order of time, padded to `max_events`. Rows beyond `count` have time inf, and zeros
    elsewhere. Axes are (event,), of a batch (*batch, event); the one event that `until` is given has none."""

    time: Float[Array, "*event"]
    """When [s]."""
    kind: Int[Array, "*event"]
    """An `EventKind`: impact 0, capture 1, release 2, switch 3; -1 in padding."""
    contact: Int[Array, "*event"]
    """Which gap closed or opened, or which of the scene's switches fell; -1 in padding."""
    before: State
    """States just before, (event, dof)."""
    after: State
    """States just after, (event, dof)."""
    impulse: Float[Array, "*event contact"]
    """Impulses of all contacts that took part [N s]; zero at a release and at a switch. Where several contacts settle
    together at the end of a cascade, single ones may be negative, by 5e-5 of the largest of the cascade."""
    closing_speed: Float[Array, "*event"]
    """-Phi' of the contact just before: how far from grazing (0) an impact was; 0 at other events [m/s]."""
    order_matters: Bool[Array, "*event"]
    """Whether contacts that act on each other, here or for other parameters, were met at one instant, so that another
    order of their impacts has another outcome: derivatives of what follows are one-sided at best."""
    count: Int[Array, "*batch"]
    """How many events there were."""
    mode: Any = None
    """Modes of a scene with switches just after, of the mode's structure with a leading axis (event,); else None."""

    @property
    def sequence(self) -> Int[Array, "*batch"]:
        """A number that two motions share if they have the same events in the same order, by kind and contact (else
        only by a rare accident). Where it changes between two steps of an optimiser, J may have a kink or a jump."""
        return sequence_number(self.kind + len(EventKind) * self.contact, self.count)

    def to_pandas(self):
        """A pandas DataFrame with a row for each event that there was: time, kind, contact, closing speed, impulse of
        that contact, place, velocities before and after; of a batch, for each event of each run. Raises: ImportError
        without pandas; ValueError for a batch of more than one axis."""
        return events_frame(self, getattr(self, "_scene", None))

    def times_of(self, contact: int, count: int, kind: EventKind | None = None) -> Float[Array, "*batch first"]:
        """Times of the first `count` events of one contact [s], for a cost: its impacts, or events of another `kind`
        (of `EventKind.SWITCH`, those of a switch). Where there are fewer, inf: a cost that is finite all the same must
        tell what that is worth, `jnp.where(jnp.isfinite(t), t, t1)`. Raises: TypeError for a name, ValueError for a
        contact that there is not, and for a `count` that is no integer from 1 to `max_events`."""
        contacts = self.impulse.shape[-1]
        if isinstance(contact, str):
            raise TypeError(f"`contact` must be its number, that of its gap from 0, but is the name {contact!r}.")
        if kind != EventKind.SWITCH and not 0 <= contact < contacts:
            raise ValueError(f"`contact` must be from 0 to {contacts - 1}, but is {contact}.")
        strikes = (self.kind == EventKind.IMPACT) | (self.kind == EventKind.CAPTURE)
        wanted = strikes if kind is None else self.kind == kind
        return first_times(self.time, wanted & (self.contact == contact), count)


def reported_events(states: EventStates, marks: EventMarks, dof: int, mode: Any = None) -> Events:
    """Events as they are reported: one, or a row for each. A scene with switches has modes; its switches are numbered
    by themselves."""
    impulse, closing_speed = states.emitted
    side = lambda x: State(x[..., :dof], x[..., dof : 2 * dof])
    number = jnp.where(marks.kind == EventKind.SWITCH, marks.number - impulse.shape[-1], marks.number)
    return Events(
        states.time, marks.kind, number, side(states.before), side(states.after), impulse, closing_speed,
        marks.order_matters, marks.count, mode,
    )  # fmt: skip


def blank_event(scene: AbstractScene, t, state: State, mode: Any) -> Events:
    """One event of a scene, which says nothing but of which shapes and types events are."""
    impulse = jnp.zeros(jax.eval_shape(scene.gap, t, state.q).shape, t.dtype)
    number = jnp.array(0)
    return Events(t, number, number, state, state, impulse, jnp.zeros_like(t), jnp.array(False), number, mode)
