"""Closed contacts without a force at this instant: which of them are pressed next.

Gauss's principle chooses by the forces at an instant. Where a load leaves one foot of a table and comes to another,
there is an instant at which neither of them carries anything, and how the forces change tells which one will. A load
that stays between the two, on the line through two other feet, presses neither: rounding alone must not tip the table.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.tolerances import closeness, rounding, time_resolution
from .contact import ContactGeometry, Instant, contact_jacobian, gap_rate_and_bias
from .delassus import Delassus
from .event_state import MEETING, EventState
from .laws import GapAcceleration, Selection
from .mass import solve_mass
from .mode import ContactMode
from .scene import AbstractScene

ROUNDED = 8
"""A gap acceleration of so many times the rounding of its terms has a sign."""


class GaussProblem(NamedTuple):
    """What Gauss's principle (T2) is asked: at an instant, or a moment later, of contacts whose multiplier and gap
    acceleration are both zero now.

    With S the contacts with a force, the principle for d/dt of (W lambda + G^T M^-1 F + gamma) is a problem of the same
    kind, W taken on what S leaves of it (its Schur complement)."""

    W: Delassus
    acceleration: GapAcceleration
    still: Bool[Array, "contact"]
    """Contacts that are asked about; a moment later these are contacts whose gaps S does not decide."""
    with_force: Bool[Array, "contact"]
    """S; and empty, as all that follows, at the instant itself."""
    undecided: Bool[Array, "contact"]
    """Closed contacts without a force."""
    released: Bool[Array, "contact"]
    pull: Float[Array, "contact"]
    """Pulls that are granted to held contacts that are not pressed [N]."""
    rounded: Float[Array, "contact"]
    """Those that are granted to contacts that have no force yet: these are rounding [N]."""

    @classmethod
    def at_once(cls, W: Delassus, acceleration: GapAcceleration, still: Bool[Array, "contact"]) -> "GaussProblem":
        """What is asked at an instant."""
        none = jnp.zeros_like(still)
        zero = jnp.zeros_like(acceleration.free)
        return cls(W, acceleration, still, none, none, none, zero, zero)

    def pressed(self, selection: Selection) -> Bool[Array, "contact"]:
        """Contacts that have a force, or will have one."""
        return self.with_force | selection.active

    def idle(self, selection: Selection) -> Bool[Array, "contact"]:
        """Closed contacts that have none and do not open."""
        return self.undecided & ~selection.active & (selection.resting | ~self.still)

    def held(self, selection: Selection, more: Bool[Array, "contact"]) -> tuple[Selection, Float[Array, "contact"]]:
        """The contacts held and resting, and what they may pull. `more` are those pressed and as many idle ones as are
        independent.

        Where idle ones are left that depend on these, some block the way of others, as the feet on both sides of the
        line through two others: no force presses any, and without them the body would be free to tip. (Where there is
        no force at all, there is no rounding either.)"""
        pressed, idle = self.pressed(selection), self.idle(selection)
        blocked = jnp.any(more & ~pressed & (self.pull > 0)) & jnp.any(idle & ~more)
        active = jnp.where(blocked, more, pressed)
        pull = jnp.where(active & (idle | self.released), self.pull, jnp.where(selection.active, self.rounded, 0))
        return Selection(active, idle & ~active), pull


class _Outlook(NamedTuple):
    """How the gaps accelerate, lambda as it is: Phi'' and its rate, and the sizes of what these are sums of."""

    acceleration: Float[Array, "contact"]
    size: Float[Array, "contact"]
    rate: Float[Array, "contact"]
    rate_size: Float[Array, "contact"]


def may_be_undecided(at_event: EventState, mode: ContactMode, selection: Selection) -> Bool[Array, ""]:
    """Whether a contact is closed without a force, or was let go beside others that are closed."""
    released = at_event.triggered & mode.active
    return jnp.any(selection.resting) | (jnp.any(released) & jnp.any(at_event.closed))


def look_ahead(scene: AbstractScene, at_event: EventState, now: Instant, mode: ContactMode, chosen) -> GaussProblem:
    """The problem that tells which contacts are pressed next. `now` is the instant after the event; what was `chosen`
    there are contacts that are closed and have no rate, and those that Gauss's principle selected of them, by these
    accelerations of the gaps."""
    (still, selection, acceleration), W = chosen, at_event.geometry.delassus
    multiplier = acceleration.multiplier(W, selection.active)
    outlook = _outlook(scene, at_event.geometry, now, mode, multiplier)
    # Forces that vanish at an event are as large here as they are where that is placed a little too early.
    located = jnp.any(at_event.triggered)
    misplaced = jnp.where(located, time_resolution(now.t, MEETING), time_resolution(now.t, 0))
    present_noise = closeness(now.q.dtype) * outlook.size + misplaced * jnp.abs(outlook.rate)
    with_force = selection.active & (multiplier * W.diagonal() > present_noise)
    released = at_event.triggered & mode.active
    undecided = ((still & (outlook.acceleration <= present_noise)) | released) & ~with_force
    soon = _soon(outlook, misplaced)
    # One that went through its margin is pressed, however little.
    less = jnp.where(at_event.triggered & ~mode.active & (mode.margin > 0), soon.noise, 0)
    tableau = W.pivoted_on(W.tableau(soon.free - less), with_force)
    left = Delassus(tableau[:, :-1], W.dof, W.mobility)
    asked = undecided & W.independent(tableau, with_force)
    pull, rounded = present_noise / W.diagonal(), ROUNDED * rounding(now.q.dtype) * outlook.size / W.diagonal()
    acceleration = GapAcceleration(tableau[:, -1], soon.noise)
    return GaussProblem(left, acceleration, asked, with_force, undecided, released, pull, rounded)


def _outlook(scene: AbstractScene, geometry: ContactGeometry, now: Instant, mode: ContactMode, multiplier) -> _Outlook:
    """By one derivative along the motion."""
    (t, q, v), J = now, geometry.jacobian
    relative = closeness(q.dtype)

    def accelerations(t, q, v):
        jacobian = contact_jacobian(scene, t, q)
        a = solve_mass(scene.mass_matrix(q), scene.force(t, q, v) + multiplier @ jacobian)
        return a, jacobian @ a + gap_rate_and_bias(scene, t, q, v)[1]

    (a, acceleration), rates = jax.linearize(accelerations, t, q, v)
    free = a - geometry.mobility @ multiplier
    of_forces = jnp.abs(free) + jnp.abs(geometry.mobility) @ jnp.abs(multiplier)
    size = jnp.abs(J) @ of_forces + jnp.abs(acceleration - J @ a)
    # A body at rest has velocities and accelerations of rounding, which a stiff spring would make much of.
    along = jnp.ones_like(t), _without_rounding(v, J, relative * mode.speed), _without_rounding(a, J, relative * size)
    a_rate, rate = rates(*along)
    return _Outlook(acceleration, size, rate, jnp.abs(J) @ jnp.abs(a_rate) + jnp.abs(rate - J @ a_rate))


def _soon(outlook: _Outlook, misplaced) -> GapAcceleration:
    """Phi'' a short time after: short beside the time in which it changes, but long beside that by which an event is
    misplaced."""
    acceleration, size, rate, rate_size = outlook
    relative, changes = closeness(rate.dtype), rate_size > 0
    time = jnp.min(jnp.where(changes, size / jnp.where(changes, rate_size, 1), jnp.inf))
    short = jnp.where(jnp.any(changes), relative**0.5 * time, 0)
    short = jnp.maximum(short, 4 * misplaced)
    noise = ROUNDED * rounding(rate.dtype) * size + relative * short * rate_size
    return GapAcceleration(acceleration + short * rate, noise)


def _without_rounding(rates: Float[Array, "dof"], J, noise) -> Float[Array, "dof"]:
    """The rates of coordinates, 0 where all that the contacts see of one is noise."""
    seen = jnp.any(jnp.abs(J) > 0, axis=0)
    return jnp.where(seen & jnp.all(jnp.abs(J * rates) <= noise[:, None], axis=0), 0, rates)
