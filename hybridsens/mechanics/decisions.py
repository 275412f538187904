"""What is decided at an event: which contacts take part, which law acts, which are held afterwards.
`MechanicalSystem.reset` then moves the state."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int

from ..flat_system import START, Decision
from ..numerics.tolerances import closeness, time_resolution
from ..status import Status
from ..watch import Seen
from .checks import may_begin
from .contact import FEW, Among, Instant, among_wanted, contact_jacobian, gap_and_rate, walls_move
from .event_state import MEETING, EventState, acted_on_nearby, look_at_event, wider_scales
from .laws import impulse_support, transition_impulse
from .mode import ROUNDED, ContactMode, EventKind, Limits, open_mode
from .scene import AbstractScene
from .settling import Impact, apply_laws
from .smoothness import has_jumped
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


class SwitchDetail(eqx.Module):
    """What the reset of an event needs to know of it."""

    contacts: Any
    """What the laws of contact need to know."""
    switch: Int[Array, ""]
    """Which switch fell; -1 where none did."""
    own: Any
    """The scene's mode before."""


class Chosen(eqx.Module):
    """What is chosen at an event."""

    own: Any
    """The scene's mode after."""
    contacts: ContactMode
    status: Status
    seen: Seen
    """The switches after."""


def decide_transition(
    scene: AbstractScene, limits: Limits, event: Int[Array, ""], now: Instant, mode: ContactMode
) -> Decision:
    """The discrete outcome of guard `event` falling through zero at (t, q, v-), of the start, or of a flow jump."""
    t, q, v = now
    if mode.active.shape[0] == 0:  # no contact to choose: all that can be said is whether the values fit
        no_contact = ImpactDetail(*4 * [mode.active])  # four empty arrays
        return Decision(mode, jnp.asarray(EventKind.IMPACT), no_contact, status=may_begin(scene, mode, event, now))
    triggered = jnp.arange(mode.active.shape[0]) == event

    def among(scene, given):
        mode, triggered = given
        here = jnp.where(event >= 0, jnp.argmax(triggered), event)  # the event's number among those looked at
        d = _decide(scene, limits, here, now, mode)
        return (d.mode, d.detail), (d.kind, d.grazing, d.status, d.first_step_bound, d.order_matters)

    gap, rate = gap_and_rate(scene, t, q, v)
    if mode.active.shape[0] > FEW:  # one may be looked at alone, and the scales of all must be known from the start
        begin = lambda: wider_scales(mode, contact_jacobian(scene, t, q), q, v, rate, limits.depth[1])
        mode = lax.cond(event < 0, begin, lambda: mode)
    # Any contact that is near 0 may be closed, at the start and at a jump of the forces too.
    size = jnp.max(mode.length) + jnp.max(jnp.abs(q))
    near = gap <= NEAR * closeness(q.dtype) * size + time_resolution(t, MEETING) * jnp.abs(rate)
    wanted = triggered | mode.held | near
    elsewhere = mode, ImpactDetail(*4 * [jnp.zeros_like(triggered)])
    (after, detail), rest = among_wanted(scene, wanted, Among(among, (mode, triggered), elsewhere))
    kind, grazing, status, bound, order_matters = rest
    status = Status.where(status == Status.running, may_begin(scene, after, event, now), status)
    return Decision(after, kind, detail, grazing, status, bound, order_matters=order_matters)


def _decide(scene: AbstractScene, limits: Limits, event, now: Instant, mode: ContactMode) -> Decision:
    """The decision among the contacts of the scene."""
    # A negative `event` is no contact. Its number is that of the last one then, and `met` masks what is read there.
    is_release = (event >= 0) & mode.active[event]
    relative, absolute = limits.depth
    at_event, mode = look_at_event(scene, limits, event, now, mode)
    deepest = relative * mode.length[event] + absolute
    met = (event >= 0) & ~is_release
    guard = at_event.gap[event] + mode.margin[event]
    jumped = met & has_jumped(guard, at_event.rate[event], mode.gap_tolerance(now.t)[event], now.t)
    status = Status.where(jumped, ContactStatus.gap_not_smooth, Status.running)
    # At the end of a cascade over several contacts impacts are as slow as that, and do not matter.
    in_cascade = at_event.in_cascade[event]
    grazing = met & ~in_cascade & _is_grazing(at_event.rate[event], at_event.gap_acceleration[event], deepest)
    if not scene.sustained_contact:
        return _bounce(scene, at_event, now, mode, grazing, status)
    impact = apply_laws(scene, limits.capture_speed, at_event, now, mode)
    after = _with_held(mode, impact, at_event, now.t)
    kind = jnp.where(after.active[event], EventKind.CAPTURE, EventKind.IMPACT)
    detail = ImpactDetail(at_event.triggered & ~is_release, impact.support, impact.plastic, impact.brought_to_rest)
    leaving = at_event.impacting & ~after.held
    first_step_bound = _first_step_bound(scene, now._replace(v=impact.v), at_event, mode, leaving)
    kind = jnp.where(is_release, EventKind.RELEASE, kind)
    order_matters = _order_matters(at_event, impact.support, mode)
    return Decision(after, kind, detail, grazing, status, first_step_bound, order_matters=order_matters)


def mode_before_any(scene: AbstractScene, t, q) -> ContactMode:
    """Every contact of a scene open, nothing remembered: what the first decision starts from."""
    contacts = jax.eval_shape(scene.gap, t, q).shape[0]
    return open_mode(contacts, q.dtype, walls_move(scene, t, q))


def initial_mode(scene: AbstractScene, t, q, v, atol) -> ContactMode:
    """Contacts that the initial state holds closed: Phi = 0 and Phi' = 0 up to rounding, chosen by (T2)."""
    limits, mode = Limits(0.0, (0.0, atol)), mode_before_any(scene, t, q)
    return decide_transition(scene, limits, jnp.array(START), Instant(t, q, v), mode).mode


def _bounce(scene: AbstractScene, at_event: EventState, now: Instant, mode: ContactMode, grazing, status) -> Decision:
    """The impact of a scene whose contacts never stay closed. Where one would, the status is `event_repeats`."""
    geometry, rate, impacting = at_event.geometry, at_event.rate, at_event.impacting
    e, no_contact = scene.restitution(), jnp.zeros_like(impacting)
    support = impulse_support(geometry, rate, e, impacting, mode.speed)
    v_after = now.v + geometry.mobility @ transition_impulse(geometry, rate, e, support).total
    first_step_bound = _first_step_bound(scene, now._replace(v=v_after), at_event, mode, impacting)
    pressed, too_slow = at_event.gap_acceleration < 0, jnp.maximum(-e * rate, 0) <= at_event.below_rounding
    stays = impacting & too_slow & pressed & at_event.triggered
    status = Status.where(jnp.any(stays), Status.event_repeats, status)
    detail = ImpactDetail(at_event.triggered, support, no_contact, no_contact)
    order_matters = _order_matters(at_event, support, mode)
    kind = jnp.asarray(EventKind.IMPACT)
    return Decision(mode, kind, detail, grazing, status, first_step_bound, order_matters=order_matters)


def _first_step_bound(scene: AbstractScene, after: Instant, at_event: EventState, mode: ContactMode, leaving):
    """Time of the shortest flight that begins here, 2 Phi' / -Phi''. A longer step could pass over it unseen. A rate
    that is rounding begins none."""
    _, rate = gap_and_rate(scene, *after)
    gap_acceleration = at_event.gap_acceleration
    falls_back = leaving & (rate > closeness(rate.dtype) * mode.speed) & (gap_acceleration < 0)
    flight = -2 * rate / jnp.where(falls_back, gap_acceleration, -1)
    return jnp.min(jnp.where(falls_back, flight, jnp.inf), initial=jnp.inf)


def _is_grazing(rate, gap_acceleration, depth) -> Bool[Array, ""]:
    """Whether an impact is as shallow as `depth`: without the contact the gap would turn back at -Phi'^2 / (2
    Phi'')."""
    return (gap_acceleration > 0) & (rate**2 <= 2 * gap_acceleration * depth)


def _order_matters(at_event: EventState, support, mode: ContactMode) -> Bool[Array, ""]:
    """Whether two contacts that were open met at this instant, and the impulse of one changes the rate of the other.

    Had one closed a little earlier, the outcome would differ by a finite amount. Contacts that are held by a force stay
    closed under any small change, so they do not count. Uncoupled contacts may meet in any order; but where they are
    uncoupled by these parameters alone, the derivative by what couples them depends on the order too."""
    rate = at_event.rate
    closing = rate < -closeness(rate.dtype) * mode.speed
    met = at_event.impacting & ~mode.active & (support | closing)
    beside = at_event.meeting & ~at_event.triggered & ~mode.active & closing
    is_impact = jnp.any(met & at_event.triggered)
    several = at_event.geometry.delassus.couples(met)
    return several | (is_impact & jnp.any(beside & acted_on_nearby(at_event.geometry, at_event.triggered)))


def _with_held(mode: ContactMode, impact: Impact, at_event: EventState, t) -> ContactMode:
    """The mode with the contacts held that an impact leaves closed, each where it is now."""
    gap = at_event.gap
    margin = jnp.where(impact.selection.resting, mode.gap_tolerance(t), impact.pull)
    # At a late clock an impact is found deeper than a projection may correct: there the contact stays.
    deep = at_event.impacting & (gap < -ROUNDED * mode.gap_tolerance(t))
    placed = jnp.where(deep, gap, jnp.maximum(gap, 0))
    held_gap = jnp.where(mode.active, mode.held_gap, placed)
    margin, held_gap = lax.stop_gradient((margin, held_gap))
    return dataclasses.replace(mode, active=impact.selection.active, margin=margin, held_gap=held_gap)
