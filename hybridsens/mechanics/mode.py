"""The discrete state of a mechanical system: which contacts are held, and what the laws remember."""

import enum
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..numerics.tolerances import closeness, rounding
from ..watch import Watch

ROUNDED = 8
"""A projection that corrects gaps by up to `ROUNDED` times `gap_tolerance`, and rates by up to `ROUNDED` times what
counts as none, is no error of a step: a contact closes with its gap off by that, and by the margin that it had."""


class Limits(NamedTuple):
    """Speeds and depths below which a rebound or a touch is neglected."""

    capture_speed: Any
    """Rebound speed, relative to the contact's fastest impact so far, below which it is captured."""
    depth: tuple[Any, Any]
    """(relative, absolute): a touch that would penetrate less deep than that is grazing."""


class EventKind(enum.IntEnum):
    """What happened at an event; the numbers in `trajectory.events.kind`."""

    IMPACT = 0
    """A gap closed and no force holds the contact closed: it opens again, or touches without a force."""
    CAPTURE = 1
    """A gap closed and the contact stays closed."""
    RELEASE = 2
    """The multiplier of a closed contact fell through zero and the contact opens."""
    SWITCH = 3
    """One of the scene's own switches fell through zero."""


class Struck(NamedTuple):
    """The impact that a contact took part in last."""

    time: Float[Array, "contact"]
    """When [s]; -inf before the first."""
    number: Int[Array, "contact"]
    """Its number, from 1 on, which contacts that met share; 0 before the first."""

    @property
    def before_another(self) -> Bool[Array, "contact"]:
        """Contacts since whose last impact another one was struck."""
        return self.number < jnp.max(self.number)

    def again(self, impacting: Bool[Array, "contact"], t) -> "Struck":
        """The same after the impact of these contacts."""
        number = jnp.where(impacting, jnp.max(self.number) + 1, self.number)
        return Struck(jnp.where(impacting, t, self.time), number)


class ContactMode(eqx.Module):
    """Mode of a scene. Nothing here is ever differentiated."""

    active: Bool[Array, "contact"]
    """Contacts held closed by a positive multiplier."""
    margin: Float[Array, "contact"]
    """What is granted to a guard, so that rounding does not fire it: penetration, to a contact that is closed without a
    multiplier of its own (a redundant foot, balls that touch at rest) [m]; a pull, to one that is held without a force
    (two feet, with the load on the line through two others) [N]; 0 for every other contact."""
    held_gap: Float[Array, "contact"]
    """Where a contact was when it closed, 0 up to rounding: there it is held, so that closing moves nothing [m]."""
    fastest: Float[Array, "contact"]
    """Largest closing speed at which the contact was hit so far: the scale of the capture speed [m/s]."""
    length: Float[Array, "contact"]
    """Largest |G|^T |q| met so far: what rounding in the gap is relative to, also where q happens to pass 0 [m]."""
    speed: Float[Array, "contact"]
    """Largest |G|^T |v| or |Phi'| met so far: what rounding in the gap rate is relative to, also at rest [m/s]."""
    wall: Float[Array, "contact"] | None
    """Largest |Phi_t| met so far: how fast the gap moves by the clock alone [m/s]; None where no gap does."""
    struck: Struck | None
    """The impact that the contact took part in last; None of a single contact."""

    @property
    def held(self) -> Bool[Array, "contact"]:
        """Contacts that are closed, with or without a multiplier."""
        return self.active | (self.margin > 0)

    def clock_length(self, t) -> Float[Array, "contact"] | float:
        """How far the wall comes while the clock comes to t: its place is rounded as that number is [m]."""
        return 0.0 if self.wall is None else self.wall * jnp.abs(t)

    def gap_tolerance(self, t) -> Float[Array, "contact"]:
        """Gaps up to this size count as closed [m]: where an event is placed, its gap is off by rounding too."""
        return closeness(self.length.dtype) * self.length + 2 * rounding(self.length.dtype) * self.clock_length(t)


def open_mode(contacts: int, dtype, walls_move: bool = False) -> ContactMode:
    """Every contact open, nothing remembered: what a motion starts from before its initial mode is chosen."""
    zero = jnp.zeros(contacts, dtype)
    struck = Struck(jnp.full(contacts, -jnp.inf, dtype), jnp.zeros(contacts, int)) if contacts > 1 else None
    return ContactMode(jnp.zeros(contacts, bool), zero, zero, zero, zero, zero, zero if walls_move else None, struck)


class SwitchedMode(eqx.Module):
    """Mode of a scene with switches."""

    contacts: ContactMode
    own: Any
    """The mode that the user's scene speaks of."""
    watch: Watch
    """Which switches can fall."""


def default_capture_speed(dtype) -> float:
    """Rebound speed, relative to the contact's fastest impact, below which a Zeno cascade is cut: eps^(1/3).

    Cutting at speed w makes an error O(w^3) in value and gradient, so this cut is lost in the rounding; where several
    contacts are struck in turn, O(w)."""
    return float(jnp.finfo(dtype).eps) ** (1 / 3)
