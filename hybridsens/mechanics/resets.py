"""What happens at an event: who takes part, which law acts, who is held afterwards."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..hybrid import Decision
from ..precision import closeness, rounding, time_resolution
from ..short import any_of, product
from ..status import Status
from .checks import may_begin
from .complementarity import independent_superset
from .contact import ContactGeometry, contact_geometry, gap_and_rate
from .laws import Selection, gap_acceleration, gauss_selection, impulse_support, transition_impulse
from .mode import ContactMode, EventKind, gap_tolerance, open_mode
from .scene import AbstractScene


class ImpactDetail(eqx.Module):
    """What `reset` has to know of a decision."""

    fired: Bool[Array, "contact"]
    """The contact whose gap fell to zero; none at a release."""
    support: Bool[Array, "contact"]
    """Contacts whose impulse is positive; none at a release, whose reset is then the identity."""
    plastic: Bool[Array, "contact"]
    """Contacts that are captured: their restitution counts as 0."""
    settled: Bool[Array, "contact"]
    """Held contacts that another one's impulse would kick off too slowly to matter: their rates are 0 after it."""


class Meeting(NamedTuple):
    """What is known at an event before any law acts."""

    geometry: ContactGeometry
    gap: Float[Array, "contact"]
    rate: Float[Array, "contact"]
    """Phi' just before."""
    gap_acceleration: Float[Array, "contact"]
    """Phi'' as the motion was before."""
    fired: Bool[Array, "contact"]
    closed: Bool[Array, "contact"]
    """Contacts that are closed at this instant."""
    struck: Bool[Array, "contact"]
    """Those of them that the law of impact is asked about: none at a release or at the start."""
    unseen: Float[Array, "contact"]
    """Rebounds slower than this hop lower than the rounding of the gap."""


class Outcome(NamedTuple):
    """What the laws leave."""

    plastic: Bool[Array, "contact"]
    support: Bool[Array, "contact"]
    settled: Bool[Array, "contact"]
    v: Float[Array, "dof"]
    """Velocities after."""
    selection: Selection


def decide_transition(
    scene: AbstractScene, capture_speed: float, depth, event: Int[Array, ""], t, q, v, mode: ContactMode
) -> Decision:
    """The discrete outcome of guard `event` falling through zero at (t, q, v-); of the start where it is -1.

    `depth` is (relative, absolute): a touch that would penetrate less deep than that is grazing.
    """
    if mode.active.shape[0] == 0:  # no contact to choose: all that can be said is whether the values fit
        nobody = ImpactDetail(*4 * [mode.active])
        return Decision(mode, jnp.asarray(EventKind.IMPACT), nobody, status=may_begin(scene, mode, event, t, q, v))
    is_release = mode.active[event]  # at the start no contact is
    meeting, mode = _meet(scene, depth[1], event, t, q, v, mode)
    status = may_begin(scene, mode, event, t, q, v)
    deepest = depth[0] * mode.length[event] + depth[1]
    met = (event >= 0) & ~is_release
    grazing = met & _is_grazing(meeting.rate[event], meeting.gap_acceleration[event], deepest)
    if not scene.sustained_contact:
        return _bounce(scene, meeting, event, t, q, v, mode, grazing, status)
    outcome = _apply_laws(scene, capture_speed, meeting, t, q, v, mode)
    after = _with_selection(mode, outcome.selection, meeting.gap)
    kind = jnp.where(after.active[event], EventKind.CAPTURE, EventKind.IMPACT)
    detail = ImpactDetail(meeting.fired & ~is_release, outcome.support, outcome.plastic, outcome.settled)
    hop = _hop(scene, t, q, outcome.v, meeting.gap_acceleration, meeting.struck & ~after.held)
    return Decision(after, jnp.where(is_release, EventKind.RELEASE, kind), detail, grazing, status, hop)


def initial_mode(scene: AbstractScene, t, q, v, atol) -> ContactMode:
    """Contacts that the initial state holds closed: Phi = 0 and Phi' = 0 up to rounding, chosen by (T2)."""
    mode = open_mode(scene.gap(t, q).shape[0], q.dtype)
    return decide_transition(scene, 0.0, (0.0, atol), jnp.array(-1), t, q, v, mode).mode


def _meet(scene: AbstractScene, atol, event, t, q, v, mode: ContactMode) -> tuple[Meeting, ContactMode]:
    """Who meets, and the mode with its memory of sizes brought up to date."""
    geometry = contact_geometry(scene, t, q)
    gap, rate = gap_and_rate(scene, t, q, v)
    pressed = gap_acceleration(scene, geometry, t, q, v).held(geometry, mode.active)
    mode = _wider_scales(mode, geometry, q, v, atol)
    tolerance = gap_tolerance(mode.length)
    start = event < 0
    fired = jnp.arange(gap.shape[0]) == event
    is_release = any_of(fired & mode.active)
    touching = _touching(geometry, event, gap, tolerance + time_resolution(t, 2) * jnp.abs(rate))
    held = mode.active | ((mode.margin > 0) & (gap <= 2 * mode.margin))
    closed = jnp.where(is_release, held & ~fired, held | fired | touching)
    closed = jnp.where(start, gap <= tolerance, closed)
    struck = closed & ~is_release & ~start
    unseen = _unseen_rate(pressed, mode)
    fastest = jnp.where(struck, jnp.maximum(mode.fastest, -rate), mode.fastest)
    meeting = Meeting(geometry, gap, rate, pressed, fired, closed, struck, unseen)
    return meeting, dataclasses.replace(mode, fastest=fastest)


def _bounce(scene: AbstractScene, meeting: Meeting, event, t, q, v, mode: ContactMode, grazing, status) -> Decision:
    """The impact of a scene whose contacts never stay closed; one that does is told by its status."""
    geometry, rate, struck = meeting.geometry, meeting.rate, meeting.struck
    e, nobody = scene.restitution(), jnp.zeros_like(struck)
    support = impulse_support(geometry, rate, e, struck, mode.speed)
    v_after = v + product(geometry.mobility, transition_impulse(geometry, rate, e, support, nobody))
    hop = _hop(scene, t, q, v_after, meeting.gap_acceleration, struck)
    stays = struck & (jnp.maximum(-e * rate, 0) <= meeting.unseen) & (meeting.gap_acceleration < 0) & meeting.fired
    status = Status.where(any_of(stays), Status.contact_stays_closed, status)
    detail = ImpactDetail(meeting.fired, support, nobody, nobody)
    return Decision(mode, jnp.asarray(EventKind.IMPACT), detail, grazing, status, hop)


def _apply_laws(scene: AbstractScene, capture_speed: float, meeting: Meeting, t, q, v, mode: ContactMode) -> Outcome:
    """The law of impact (T3) and Gauss's principle (T2), with rebounds that are too slow to matter cut.

    A rebound that is slow (or not to be seen above the rounding of the gap) is plastic, but only where the contact is
    pressed: a grazing contact leaves slowly too, and has to keep its rebound. So the law is applied with every slow
    contact plastic (turn 0), then with those of them that were held (turn 1). An impact also kicks neighbours off,
    which fall back and kick in their turn: where contacts leave too slowly to matter and Gauss's principle holds all
    of them together (turn 2), their rates are made 0 (turn 3). One loop, so that the laws are compiled once.
    """
    geometry, rate, struck = meeting.geometry, meeting.rate, meeting.struck
    e = scene.restitution()
    nobody = jnp.zeros_like(struck)
    cut = capture_speed * mode.fastest
    slow = struck & (e * jnp.abs(rate) <= jnp.maximum(cut, meeting.unseen))
    still = closeness(q.dtype) * mode.speed
    alone = struck.shape[0] == 1  # one contact has no neighbour to settle with

    def turn(k, last: Outcome) -> Outcome:
        restitution = jnp.where(last.plastic, 0, e)
        support = impulse_support(geometry, rate, restitution, struck, mode.speed)
        v_after = v + product(geometry.mobility, transition_impulse(geometry, rate, restitution, support, last.settled))
        _, rate_after = gap_and_rate(scene, t, q, v_after)
        acceleration = gap_acceleration(scene, geometry, t, q, v_after)
        together = (k == 2) & (not alone)
        who, limit = meeting.closed, still
        if not alone:
            falls = acceleration.held(geometry, last.selection.active)
            slow_to_leave = jnp.maximum(cut, _unseen_rate(falls, mode))
            who, limit = jnp.where(together, struck, who), jnp.where(together, jnp.maximum(still, slow_to_leave), still)
        selection = gauss_selection(geometry, acceleration, rate_after, who, limit)
        plastic = jnp.where(k == 0, slow & selection.active, last.plastic)
        settled = last.settled
        if not alone:
            rests = selection.active | selection.resting
            more = any_of(rests & ~(last.selection.active | last.selection.resting))
            all_of_them = independent_superset(geometry.delassus_matrix, selection.active, rests)
            settled = jnp.where(together, all_of_them & more, settled)
        return Outcome(plastic, support, settled, v_after, selection)

    start = Outcome(slow, nobody, nobody, v, Selection(nobody, nobody))
    return lax.fori_loop(0, 2 if alone else 4, turn, start)


def _unseen_rate(gap_acceleration, mode: ContactMode):
    """Rates up to which a contact that falls back hops lower than the rounding of its gap."""
    return jnp.sqrt(4 * rounding(mode.length.dtype) * jnp.abs(gap_acceleration) * mode.length)


def _hop(scene: AbstractScene, t, q, v, gap_acceleration, leaving):
    """Time of the shortest flight that begins here, 2 Phi' / -Phi''. A longer step could pass over a hop unseen."""
    _, rate = gap_and_rate(scene, t, q, v)
    falls_back = leaving & (rate > 0) & (gap_acceleration < 0)
    return jnp.min(
        jnp.where(falls_back, -2 * rate / jnp.where(falls_back, gap_acceleration, -1), jnp.inf), initial=jnp.inf
    )


def _is_grazing(rate, gap_acceleration, depth) -> Bool[Array, ""]:
    """Whether an impact is as shallow as `depth`: without the contact the gap would turn back at -Phi'^2 / (2
    Phi'')."""
    return (gap_acceleration > 0) & (rate**2 <= 2 * gap_acceleration * depth)


def _touching(geometry: ContactGeometry, event, gap, tolerance):
    """Contacts closed at this instant that the struck one acts on; uncoupled ones have an event of their own."""
    W = geometry.delassus_matrix
    size = jnp.sqrt(jnp.abs(jnp.diag(W) * W[event, event]))
    coupled = jnp.abs(W[event]) > closeness(gap.dtype) * size
    return coupled & (gap <= tolerance)


def _wider_scales(mode: ContactMode, geometry: ContactGeometry, q, v, atol) -> ContactMode:
    """Sizes of gaps and rates, at least what `atol`, the caller's word for a size that does not matter, says: it
    gives a scale to a scene that rests at the origin."""
    size = jnp.abs(geometry.jacobian)
    floor = float(jnp.finfo(q.dtype).eps) ** (-1 / 3) * atol * jnp.sum(size, axis=1)
    length, speed = (
        jnp.maximum(jnp.maximum(known, floor), product(size, jnp.abs(of)))
        for known, of in ((mode.length, q), (mode.speed, v))
    )
    return dataclasses.replace(mode, length=length, speed=speed)


def _with_selection(mode: ContactMode, selection: Selection, gap) -> ContactMode:
    margin = jnp.where(selection.resting, gap_tolerance(mode.length), 0)
    held_gap = jnp.where(mode.active, mode.held_gap, jnp.maximum(gap, 0))
    return dataclasses.replace(mode, active=selection.active, margin=margin, held_gap=lax.stop_gradient(held_gap))
