"""What happens at an event: who takes part, which law acts, who is held afterwards."""

import dataclasses
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import Decision
from ..numerics.small_arrays import any_of, product
from ..numerics.tolerances import closeness
from ..status import Status
from .checks import may_begin
from .complementarity import independent_superset
from .contact import gap_and_rate
from .corners import has_jumped
from .event_state import EventState, look_at_event, rate_below_rounding
from .few import among_few
from .laws import Selection, gap_acceleration, gauss_selection, impulse_support, transition_impulse
from .mode import ContactMode, EventKind, gap_tolerance, open_mode
from .scene import AbstractScene
from .status import ContactStatus

NEAR = 1e3
"""Gaps up to so many times what counts as closed are looked at, where not all are: a scale may have grown since."""


class ImpactDetail(eqx.Module):
    """What `reset` has to know of a decision."""

    triggered: Bool[Array, "contact"]
    """The contact whose gap fell to zero; none at a release."""
    support: Bool[Array, "contact"]
    """Contacts whose impulse is positive; none at a release, whose reset is then the identity."""
    plastic: Bool[Array, "contact"]
    """Contacts that are captured: their restitution counts as 0."""
    brought_to_rest: Bool[Array, "contact"]
    """Held contacts that another one's impulse would kick off too slowly to matter: their rates are 0 after it."""


class Outcome(NamedTuple):
    """What the laws leave."""

    plastic: Bool[Array, "contact"]
    support: Bool[Array, "contact"]
    brought_to_rest: Bool[Array, "contact"]
    v: Float[Array, "dof"]
    """Velocities after."""
    selection: Selection


def decide_transition(
    scene: AbstractScene, capture_speed, depth, event: Int[Array, ""], t, q, v, mode: ContactMode
) -> Decision:
    """The discrete outcome of guard `event` falling through zero at (t, q, v-); of the start where it is -1, of a jump
    of the forces where it is -2.

    `depth` is (relative, absolute): a touch that would penetrate less deep than that is grazing.
    """
    if mode.active.shape[0] == 0:  # no contact to choose: all that can be said is whether the values fit
        no_contact = ImpactDetail(*4 * [mode.active])
        return Decision(mode, jnp.asarray(EventKind.IMPACT), no_contact, status=may_begin(scene, mode, event, t, q, v))
    triggered = jnp.arange(mode.active.shape[0]) == event

    def among(scene, given):
        mode, triggered = given
        here = jnp.where(event >= 0, jnp.argmax(triggered), event)  # where the event is among those looked at
        verdict = _judge(scene, capture_speed, depth, here, t, q, v, mode)
        return (verdict.mode, verdict.detail), verdict._replace(mode=None, detail=None)

    # At the start and at a jump of the forces any contact may be closed; at an event those near 0, and those held.
    near = scene.gap(t, q) <= NEAR * closeness(q.dtype) * (jnp.max(mode.length) + jnp.max(jnp.abs(q)))
    wanted = triggered | mode.held | near | (event < 0)
    elsewhere = mode, ImpactDetail(*4 * [jnp.zeros_like(triggered)])
    (after, detail), verdict = among_few(scene, wanted, among, (mode, triggered), elsewhere)
    status = Status.where(verdict.status == Status.running, may_begin(scene, after, event, t, q, v), verdict.status)
    return Decision(
        after,
        verdict.kind,
        detail,
        verdict.grazing,
        status,
        verdict.first_step_bound,
        order_matters=verdict.order_matters,
    )


class Verdict(NamedTuple):
    """What is decided among some contacts: the parts of a Decision."""

    mode: Any
    detail: Any
    kind: Int[Array, ""]
    grazing: Bool[Array, ""]
    status: Status
    first_step_bound: Float[Array, ""]
    order_matters: Bool[Array, ""]


def _judge(scene: AbstractScene, capture_speed, depth, event, t, q, v, mode: ContactMode) -> Verdict:
    """The decision among the contacts of the scene."""
    is_release = (event >= 0) & mode.active[event]
    at_event, mode = look_at_event(scene, depth[1], event, t, q, v, mode)
    deepest = depth[0] * mode.length[event] + depth[1]
    met = (event >= 0) & ~is_release
    guard = at_event.gap[event] + mode.margin[event]
    jumped = met & has_jumped(guard, at_event.rate[event], mode.length[event], t)
    status = Status.where(jumped, ContactStatus.gap_not_smooth, Status.running)
    grazing = met & _is_grazing(at_event.rate[event], at_event.gap_acceleration[event], deepest)
    if not scene.sustained_contact:
        return _bounce(scene, at_event, event, t, q, v, mode, grazing, status)
    outcome = _apply_laws(scene, capture_speed, at_event, t, q, v, mode)
    after = _with_selection(mode, outcome.selection, at_event.gap)
    kind = jnp.where(after.active[event], EventKind.CAPTURE, EventKind.IMPACT)
    detail = ImpactDetail(at_event.triggered & ~is_release, outcome.support, outcome.plastic, outcome.brought_to_rest)
    first_step_bound = _first_step_bound(
        scene, t, q, outcome.v, at_event.gap_acceleration, at_event.impacting & ~after.held
    )
    kind = jnp.where(is_release, EventKind.RELEASE, kind)
    order_matters = _order_matters(at_event, outcome.support, mode)
    return Verdict(after, detail, kind, grazing, status, first_step_bound, order_matters)


def initial_mode(scene: AbstractScene, t, q, v, atol) -> ContactMode:
    """Contacts that the initial state holds closed: Phi = 0 and Phi' = 0 up to rounding, chosen by (T2)."""
    mode = open_mode(scene.gap(t, q).shape[0], q.dtype)
    return decide_transition(scene, 0.0, (0.0, atol), jnp.array(-1), t, q, v, mode).mode


def _bounce(scene: AbstractScene, at_event: EventState, event, t, q, v, mode: ContactMode, grazing, status) -> Verdict:
    """The impact of a scene whose contacts never stay closed; one that does is told by its status."""
    geometry, rate, impacting = at_event.geometry, at_event.rate, at_event.impacting
    e, no_contact = scene.restitution(), jnp.zeros_like(impacting)
    support = impulse_support(geometry, rate, e, impacting, mode.speed)
    v_after = v + product(geometry.mobility, transition_impulse(geometry, rate, e, support, no_contact))
    first_step_bound = _first_step_bound(scene, t, q, v_after, at_event.gap_acceleration, impacting)
    stays = (
        impacting
        & (jnp.maximum(-e * rate, 0) <= at_event.below_rounding)
        & (at_event.gap_acceleration < 0)
        & at_event.triggered
    )
    status = Status.where(any_of(stays), Status.event_repeats, status)
    detail = ImpactDetail(at_event.triggered, support, no_contact, no_contact)
    order_matters = _order_matters(at_event, support, mode)
    return Verdict(mode, detail, jnp.asarray(EventKind.IMPACT), grazing, status, first_step_bound, order_matters)


def _apply_laws(scene: AbstractScene, capture_speed, at_event: EventState, t, q, v, mode: ContactMode) -> Outcome:
    """The law of impact (T3) and Gauss's principle (T2), with rebounds that are too slow to matter cut.

    A rebound that is slow (or not to be seen above the rounding of the gap) is plastic, but only where the contact is
    pressed: a grazing contact leaves slowly too, and has to keep its rebound. So the law is applied with every slow
    contact plastic (turn 0), then with those of them that were held (turn 1). An impact also kicks neighbours off,
    which fall back and kick in their turn: where contacts leave too slowly to matter and Gauss's principle holds all
    of them together (turn 2), their rates are made 0 (turn 3). One loop, so that the laws are compiled once; turns that
    cannot change anything are left out.
    """
    geometry, rate, impacting = at_event.geometry, at_event.rate, at_event.impacting
    e = scene.restitution()
    no_contact = jnp.zeros_like(impacting)
    cut = capture_speed * mode.fastest
    slow = impacting & (e * jnp.abs(rate) <= jnp.maximum(cut, at_event.below_rounding))
    still = closeness(q.dtype) * mode.speed
    alone = impacting.shape[0] == 1

    def turn(k, last: Outcome) -> Outcome:
        restitution = jnp.where(last.plastic, 0, e)
        support = impulse_support(geometry, rate, restitution, impacting, mode.speed)
        v_after = v + product(
            geometry.mobility, transition_impulse(geometry, rate, restitution, support, last.brought_to_rest)
        )
        _, rate_after = gap_and_rate(scene, t, q, v_after)
        acceleration = gap_acceleration(scene, geometry, t, q, v_after)
        together = (k == 2) & (not alone)
        who, limit = at_event.closed, still
        if not alone:
            falls = acceleration.held(geometry, last.selection.active)
            slow_to_leave = jnp.maximum(cut, rate_below_rounding(falls, mode))
            who, limit = (
                jnp.where(together, impacting, who),
                jnp.where(together, jnp.maximum(still, slow_to_leave), still),
            )
        selection = gauss_selection(geometry, acceleration, rate_after, who, limit)
        plastic = jnp.where(k == 0, slow & selection.active, last.plastic)
        brought_to_rest = last.brought_to_rest
        if not alone:
            rests = selection.active | selection.resting
            more = any_of(rests & ~(last.selection.active | last.selection.resting))
            all_of_them = independent_superset(geometry.delassus_matrix, selection.active, rests)
            brought_to_rest = jnp.where(together, all_of_them & more, brought_to_rest)
        return Outcome(plastic, support, brought_to_rest, v_after, selection)

    def next_turn(carry):
        k, last = carry
        outcome = turn(k, last)
        as_it_was = (k == 0) & ~any_of(outcome.plastic != last.plastic)  # turn 1 would apply the same law again
        return jnp.where(as_it_was, 2, k + 1), outcome

    several = (not alone) & (jnp.sum(impacting) > 1)  # one contact has no neighbour to settle with
    turns = jnp.where(several, 4, 2)
    start = Outcome(slow, no_contact, no_contact, v, Selection(no_contact, no_contact))
    return lax.while_loop(lambda carry: carry[0] < turns, next_turn, (jnp.array(0), start))[1]


def _first_step_bound(scene: AbstractScene, t, q, v, gap_acceleration, leaving):
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


def _order_matters(at_event: EventState, support, mode: ContactMode) -> Bool[Array, ""]:
    """Whether two contacts that were open met at this instant, and the impulse of one changes the rate of the other.

    Had one closed a little earlier, the outcome would differ by a finite amount. Contacts that are held by a force stay
    closed under any small change, so they do not count. Uncoupled contacts may be struck in any order."""
    rate, W = at_event.rate, at_event.geometry.delassus_matrix
    takes_part = support | (rate < -closeness(rate.dtype) * mode.speed)
    met = at_event.impacting & ~mode.active & takes_part
    diagonal = jnp.abs(jnp.diag(W))
    coupled = jnp.abs(W) > closeness(W.dtype) * jnp.sqrt(diagonal[:, None] * diagonal)
    pairs = met[:, None] & met & coupled & ~jnp.eye(met.shape[0], dtype=bool)
    return jnp.any(pairs)


def _with_selection(mode: ContactMode, selection: Selection, gap) -> ContactMode:
    margin = jnp.where(selection.resting, gap_tolerance(mode.length), 0)
    held_gap = jnp.where(mode.active, mode.held_gap, jnp.maximum(gap, 0))
    return dataclasses.replace(mode, active=selection.active, margin=margin, held_gap=lax.stop_gradient(held_gap))
