"""What the laws leave at an event: the velocities after it, and contacts that leave too slowly to matter at rest."""

import enum
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..numerics.tolerances import closeness
from .complementarity import independent_superset
from .contact import Instant, gap_and_rate
from .event_state import EventState, rate_below_rounding
from .laws import Selection, gap_acceleration, gauss_selection, impulse_support, transition_impulse
from .mode import ContactMode
from .scene import AbstractScene

AMPLIFIED = 100
"""Contacts are brought to rest if that changes at most so many times the energy that their rates have alone: of walls
that meet at an angle, at speeds up to 10 times those that count as rest."""


class Impact(NamedTuple):
    """What the laws leave."""

    plastic: Bool[Array, "contact"]
    support: Bool[Array, "contact"]
    brought_to_rest: Bool[Array, "contact"]
    v: Float[Array, "dof"]
    """Velocities after."""
    selection: Selection


class Turn(enum.IntEnum):
    """Turns of `apply_laws`, in their order."""

    SLOW_PLASTIC = 0
    """The law with every slow contact plastic."""
    HELD_PLASTIC = 1
    """The law with those plastic that were held then. It is left out where they are the same."""
    TOGETHER = 2
    """A test whether Gauss's principle holds neighbours that leave slowly, all of them together."""
    BROUGHT_TO_REST = 3
    """The law with those at rest; it is needed in any case, since the turn before selected with a wider limit. Impulses
    that bring to rest may pull other contacts closed: the turn is repeated with these, until none is pulled."""


def apply_laws(scene: AbstractScene, capture_speed, at_event: EventState, now: Instant, mode: ContactMode) -> Impact:
    """The law of impact (T3) and Gauss's principle (T2), with rebounds that are too slow to matter cut.

    A rebound that is slow (or not to be seen above the rounding of the gap) is plastic, but only where the contact is
    pressed: a grazing contact leaves slowly too, and has to keep its rebound. An impact also kicks neighbours off,
    which fall back and kick in their turn: contacts that leave too slowly to matter are brought to rest together.
    One loop over `Turn`, so that the laws are compiled once; a contact without a neighbour needs the first two alone.
    """
    impacting, no_contact = at_event.impacting, jnp.zeros_like(at_event.impacting)
    cut = capture_speed * mode.fastest
    slow = impacting & (scene.restitution() * jnp.abs(at_event.rate) <= jnp.maximum(cut, at_event.below_rounding))
    laws = _Laws(scene, at_event, now, mode, slow, cut)

    def take_turn(carry):
        turn, last = carry
        impact = laws.apply(turn, last)
        skips = (turn == Turn.SLOW_PLASTIC) & ~jnp.any(impact.plastic != last.plastic)
        repeats = (turn == Turn.BROUGHT_TO_REST) & jnp.any(impact.brought_to_rest != last.brought_to_rest)
        return jnp.where(skips, Turn.TOGETHER, jnp.where(repeats, Turn.BROUGHT_TO_REST, turn + 1)), impact

    several = (not laws.one_contact) & (jnp.sum(impacting) > 1)  # one contact has no neighbour to settle with
    turns = jnp.where(several, len(Turn), Turn.TOGETHER)
    start = Impact(slow, no_contact, no_contact, now.v, Selection(no_contact, no_contact))
    return lax.while_loop(lambda carry: carry[0] < turns, take_turn, (jnp.array(0), start))[1]


class _Laws(NamedTuple):
    """The laws at one event."""

    scene: AbstractScene
    at_event: EventState
    now: Instant
    mode: ContactMode
    slow: Bool[Array, "contact"]
    """Contacts whose rebound is too slow to matter."""
    cut: Float[Array, "contact"]
    """Speeds below which contacts do not leave."""

    @property
    def one_contact(self) -> bool:
        """Whether the scene has one contact, which has no neighbour."""
        return self.slow.shape[0] == 1

    @property
    def rest_speed(self):
        """What counts as no rate."""
        return closeness(self.now.q.dtype) * self.mode.speed

    def apply(self, turn: Int[Array, ""], last: Impact) -> Impact:
        """One turn, from what the last one left: impulses, the velocities after them, and the contacts held then."""
        (t, q, v), geometry, impacting = self.now, self.at_event.geometry, self.at_event.impacting
        restitution = jnp.where(last.plastic, 0, self.scene.restitution())
        support = impulse_support(geometry, self.at_event.rate, restitution, impacting, self.mode.speed)
        rests = None if self.one_contact else last.brought_to_rest
        impulse = transition_impulse(geometry, self.at_event.rate, restitution, support, rests)
        v_after = v + geometry.mobility @ impulse.total
        _, rate = gap_and_rate(self.scene, t, q, v_after)
        acceleration = gap_acceleration(self.scene, geometry, t, q, v_after)
        candidates, limit = self.at_event.closed, jnp.maximum(self.rest_speed, self._speed_below_zero())
        if impulse.settling_energy is not None:
            settle_speed = self._settle_speed(acceleration.held(geometry, last.selection.active))
            candidates = jnp.where(turn == Turn.TOGETHER, impacting, candidates)
            limit = jnp.where(turn == Turn.TOGETHER, settle_speed, limit)
        selection = gauss_selection(geometry, acceleration, rate, candidates, limit)
        plastic = jnp.where(turn == Turn.SLOW_PLASTIC, self.slow & selection.active, last.plastic)
        brought_to_rest = last.brought_to_rest
        if impulse.settling_energy is not None:
            is_little = impulse.settling_energy <= self._little_energy(settle_speed, brought_to_rest)
            brought_to_rest = self._brought_to_rest(turn, last, selection, rate) & (is_little | (turn == Turn.TOGETHER))
        return Impact(plastic, support, brought_to_rest, v_after, selection)

    def _speed_below_zero(self):
        """Of contacts that are chosen anew, as at the start: up to this rate one whose gap is below zero by rounding
        falls back before it comes to zero, and would never be seen to leave."""
        depth, falls = jnp.maximum(-self.at_event.gap, 0), jnp.maximum(-self.at_event.gap_acceleration, 0)
        return jnp.where(self.at_event.impacting, 0, jnp.sqrt(2 * falls * depth))

    def _settle_speed(self, accelerations):
        """Below it a neighbour that is kicked off falls back at once, at these accelerations of the gaps."""
        below_rounding = rate_below_rounding(accelerations, self.now.t, self.mode)
        return jnp.maximum(self.rest_speed, jnp.maximum(self.cut, below_rounding))

    def _little_energy(self, settle_speed, brought_to_rest):
        """What bringing to rest may change, as twice a kinetic energy. Contacts at a small angle d have rates that are
        too slow to matter while the body goes by with a speed of 1 / d times as much: it must not be stopped."""
        of_each = settle_speed**2 / jnp.where(brought_to_rest, self.at_event.geometry.delassus.diagonal(), 1)
        return AMPLIFIED * jnp.sum(jnp.where(brought_to_rest, of_each, 0))

    def _brought_to_rest(self, turn, last: Impact, selection: Selection, rate) -> Bool[Array, "contact"]:
        """First those that rest, were all held together, if that is more than before; then those that are pulled closed
        too. Only contacts that are independent of each other can be brought to rest."""
        together = turn == Turn.TOGETHER
        rests = selection.active | selection.resting
        more = jnp.any(rests & ~(last.selection.active | last.selection.resting))
        so_far = last.brought_to_rest
        pulled = (turn == Turn.BROUGHT_TO_REST) & jnp.any(so_far) & self.at_event.impacting & (rate < -self.rest_speed)
        first = jnp.where(together, selection.active, so_far)
        wanted = jnp.where(together, rests, so_far | pulled)
        return independent_superset(self.at_event.geometry.delassus, first, wanted) & (more | ~together)
