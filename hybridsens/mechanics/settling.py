"""What the laws leave at an event: the velocities after it, and contacts that leave too slowly to matter at rest."""

import enum
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..numerics.tolerances import closeness
from .complementarity import independent_superset
from .contact import Instant, gap_and_rate
from .event_state import EventState, rate_below_rounding
from .handover import GaussProblem, look_ahead, may_be_undecided
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
    pull: Float[Array, "contact"]
    """What one that is held without a force may pull by rounding, before it is let go [N]."""
    settle_speed: Float[Array, "contact"]
    """Speeds below which a neighbour that is kicked off falls back at once, as it falls while it is not held."""


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
    AHEAD = 4
    """Which of the contacts that are closed without a force are pressed next. It is left out where there are none."""


def apply_laws(scene: AbstractScene, capture_speed, at_event: EventState, now: Instant, mode: ContactMode) -> Impact:
    """The law of impact (T3) and Gauss's principle (T2), with rebounds that are too slow to matter cut.

    A rebound that is slow (or not to be seen above the rounding of the gap) is plastic, but only where the contact is
    pressed: a grazing contact leaves slowly too, and has to keep its rebound. An impact also kicks neighbours off,
    which fall back and kick in their turn: contacts that leave too slowly to matter are brought to rest together.
    One loop over `Turn`, so that the laws are compiled once; a contact without a neighbour needs the first two alone.
    """
    impacting, no_contact = at_event.impacting, jnp.zeros_like(at_event.impacting)
    cut = capture_speed * mode.fastest
    rebound = scene.restitution() * jnp.abs(at_event.rate)
    too_slow = (rebound <= cut) & ~jnp.any(at_event.in_turn)  # a cascade of several contacts ends for all at once
    slow = impacting & (too_slow | (rebound <= at_event.below_rounding))
    laws = _Laws(scene, at_event, now, mode, slow, cut)

    def take_turn(carry):
        turn, last = carry
        impact = laws.apply(turn, last)
        return laws.turn_after(turn, last, impact), impact

    nothing = jnp.zeros_like(at_event.gap)
    start = Impact(slow, no_contact, no_contact, now.v, Selection(no_contact, no_contact), nothing, nothing)
    return lax.while_loop(lambda carry: carry[0] < len(Turn), take_turn, (jnp.array(0), start))[1]


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

    def turn_after(self, turn: Int[Array, ""], last: Impact, impact: Impact) -> Int[Array, ""]:
        """The turn that follows one that made `impact` out of `last`."""
        skips = (turn == Turn.SLOW_PLASTIC) & ~jnp.any(impact.plastic != last.plastic)
        repeats = (turn == Turn.BROUGHT_TO_REST) & jnp.any(impact.brought_to_rest != last.brought_to_rest)
        following = jnp.where(skips, Turn.TOGETHER, jnp.where(repeats, Turn.BROUGHT_TO_REST, turn + 1))
        if self.one_contact:  # it has no neighbour to settle with, and none to hand a force to
            return jnp.where(following == Turn.TOGETHER, len(Turn), following)
        several = jnp.sum(self.at_event.impacting) > 1
        following = jnp.where((following == Turn.TOGETHER) & ~several, Turn.AHEAD, following)
        decided = ~may_be_undecided(self.at_event, self.mode, impact.selection)
        return jnp.where((following == Turn.AHEAD) & decided, len(Turn), following)

    def apply(self, turn: Int[Array, ""], last: Impact) -> Impact:
        """One turn, from what the last one left: impulses, the velocities after them, and the contacts held then."""
        geometry = self.at_event.geometry
        impact, energy = self._struck(last)
        after = self.now._replace(v=impact.v)
        _, rate = gap_and_rate(self.scene, *after)
        acceleration = gap_acceleration(self.scene, geometry, *after)
        if energy is None:
            still = self.at_event.closed & (jnp.abs(rate) <= self._least_speed())
            selection = gauss_selection(geometry.delassus, acceleration, still)
            return impact._replace(selection=selection, plastic=self._plastic(turn, last, selection))
        settle_speed = self._settle_speed(acceleration.held(geometry.delassus, last.selection.active))
        settle_speed = jnp.where(turn == Turn.BROUGHT_TO_REST, last.settle_speed, settle_speed)
        problem = self._problem(turn, impact, (acceleration, rate), settle_speed)
        selection = gauss_selection(problem.W, problem.acceleration, problem.still)
        impact = impact._replace(selection=selection, plastic=self._plastic(turn, last, selection))
        impact = impact._replace(settle_speed=settle_speed)
        is_little = energy <= self._little_energy(settle_speed, last.brought_to_rest)
        return self._joined(turn, last, impact, (problem, rate, is_little | (turn == Turn.TOGETHER)))

    def _struck(self, last: Impact) -> tuple[Impact, Float[Array, ""] | None]:
        """The velocities after the impulses, and what settling changes of the energy."""
        geometry, rate, restitution = self.at_event.geometry, self.at_event.rate, self.scene.restitution()
        restitution = jnp.where(last.plastic, 0, restitution)
        support = impulse_support(geometry, rate, restitution, self.at_event.impacting, self.mode.speed)
        rests = None if self.one_contact else last.brought_to_rest
        impulse = transition_impulse(geometry, rate, restitution, support, rests)
        v_after = self.now.v + geometry.mobility @ impulse.total
        return last._replace(support=support, v=v_after), impulse.settling_energy

    def _problem(self, turn, impact: Impact, after, settle_speed) -> GaussProblem:
        """What Gauss's principle is asked in a turn: which contacts are held now, or which are pressed next."""
        acceleration, rate = after
        together = turn == Turn.TOGETHER
        candidates = jnp.where(together, self.at_event.impacting, self.at_event.closed)
        still = candidates & (jnp.abs(rate) <= jnp.where(together, settle_speed, self._least_speed()))
        at_once = lambda: GaussProblem.at_once(self.at_event.geometry.delassus, acceleration, still)
        after = self.now._replace(v=impact.v)
        chosen = still, impact.selection, acceleration
        ahead = lambda: look_ahead(self.scene, self.at_event, after, self.mode, chosen)
        return lax.cond(turn == Turn.AHEAD, ahead, at_once)

    def _plastic(self, turn, last: Impact, selection: Selection) -> Bool[Array, "contact"]:
        ends = selection.active | self.at_event.just_struck
        return jnp.where(turn == Turn.SLOW_PLASTIC, self.slow & ends, last.plastic)

    def _least_speed(self):
        """Rates up to this one count as none."""
        return jnp.maximum(self.rest_speed, self._speed_below_zero())

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

    def _joined(self, turn, last: Impact, impact: Impact, given) -> Impact:
        """What is added to the contacts that are pressed, as far as these are independent of each other: contacts that
        are brought to rest, or, once it is told who is pressed next, those that block each other's way.

        First those are brought to rest that rest, were all held together, if that is more than before; then those too
        that are pulled closed."""
        problem, rate, is_little = given
        together, ahead = turn == Turn.TOGETHER, turn == Turn.AHEAD
        selection = impact.selection
        rests = selection.active | selection.resting
        so_far = last.brought_to_rest
        pulled = (turn == Turn.BROUGHT_TO_REST) & jnp.any(so_far) & self.at_event.impacting & (rate < -self.rest_speed)
        first = jnp.where(ahead, problem.pressed(selection), jnp.where(together, selection.active, so_far))
        wanted = jnp.where(ahead, problem.idle(selection), jnp.where(together, rests, so_far | pulled))
        more = independent_superset(self.at_event.geometry.delassus, first, wanted)
        is_more = jnp.any(rests & ~(last.selection.active | last.selection.resting)) | ~together
        brought_to_rest = jnp.where(ahead, so_far, more & is_more & is_little)
        held, pull = problem.held(selection, more)
        selection = jax.tree.map(lambda new, old: jnp.where(ahead, new, old), held, selection)
        return impact._replace(brought_to_rest=brought_to_rest, selection=selection, pull=jnp.where(ahead, pull, 0))
