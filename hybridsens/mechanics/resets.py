"""What happens at an event: who takes part, which law acts, who is held afterwards."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ..hybrid import Decision
from ..precision import closeness, rounding, time_resolution
from .contact import ContactGeometry, contact_geometry, gap_and_rate, gap_rate_and_bias
from .flow import acceleration
from .laws import Selection, gauss_selection, impact_impulse, impulse_support, settling_impulse
from .mode import ContactMode, EventKind, gap_tolerance
from .scene import AbstractScene


class ImpactDetail(eqx.Module):
    """What `reset` has to know of a decision."""

    support: Bool[Array, "contact"]
    """Contacts whose impulse is positive; none at a release, whose reset is then the identity."""
    plastic: Bool[Array, "contact"]
    """Contacts that are captured: their restitution counts as 0."""
    settled: Bool[Array, "contact"]
    """Held contacts that another one's impulse would kick off too slowly to matter: their rates are 0 after it."""


def decide_transition(scene: AbstractScene, capture_speed: float, depth, event, t, q, v, mode: ContactMode) -> Decision:
    """The discrete outcome of guard `event` falling through zero at (t, q, v-).

    `depth` is (relative, absolute): a touch that would penetrate less deep than that is grazing.
    """
    if mode.active.shape[0] == 0:  # nothing to meet: never called, but its shape is asked for
        return Decision(mode, jnp.asarray(EventKind.IMPACT), ImpactDetail(mode.active, mode.active, mode.active))
    geometry = contact_geometry(scene, t, q)
    gap, rate = gap_and_rate(scene, t, q, v)
    gap_acceleration = _gap_acceleration(scene, geometry, t, q, v, mode)
    mode = _wider_scales(mode, geometry, q, v)
    fired = jnp.arange(gap.shape[0]) == event
    is_release = mode.active[event]
    touching = _touching(geometry, event, gap, gap_tolerance(mode.length) + time_resolution(t, 2) * jnp.abs(rate))
    held = mode.active | ((mode.margin > 0) & (gap <= 2 * mode.margin))
    closed = jnp.where(is_release, held & ~fired, held | fired | touching)
    struck = closed & ~is_release
    fastest = jnp.where(struck, jnp.maximum(mode.fastest, -rate), mode.fastest)
    mode = dataclasses.replace(mode, fastest=fastest)
    grazing = ~is_release & _is_grazing(rate[event], gap_acceleration[event], depth[0] * mode.length[event] + depth[1])
    e = scene.restitution()

    unseen = jnp.sqrt(4 * rounding(q.dtype) * jnp.abs(gap_acceleration) * mode.length)  # lower hops are rounding
    nobody = jnp.zeros_like(closed)

    def impact(plastic):
        restitution = jnp.where(plastic, 0, e)
        support = impulse_support(geometry, rate, restitution, struck, mode.speed)
        return support, v + geometry.mobility @ impact_impulse(geometry, rate, restitution, support)

    if not scene.sustained_contact:
        support, v_after = impact(nobody)
        hop = _hop(scene, t, q, v_after, gap_acceleration, struck)
        stays = (jnp.maximum(-e * rate, 0) <= unseen)[event] & (gap_acceleration[event] < 0)
        return Decision(mode, jnp.asarray(EventKind.IMPACT), ImpactDetail(support, nobody, nobody), grazing, stays, hop)

    # A rebound too slow to matter (or to be seen above the rounding of the gap) is plastic, but only where the
    # contact is pressed together: a grazing contact leaves slowly too, and has to keep its rebound. So the law is
    # applied twice: with every slow contact plastic, and with those of them that were held then.
    slow = struck & (e * jnp.abs(rate) <= jnp.maximum(capture_speed * fastest, unseen))
    slowest = closeness(q.dtype) * mode.speed

    def law(_, carry):
        plastic = carry[3]
        support, v_after = impact(plastic)
        selection = gauss_selection(scene, geometry, t, q, v_after, closed, slowest)
        return plastic, support, selection, slow & selection.active, v_after

    start = (nobody, nobody, Selection(nobody, nobody), slow, v)
    plastic, support, selection, _, v_after = lax.fori_loop(0, 2, law, start)
    settled, v_after = _settle(scene, geometry, t, q, v_after, mode, selection.active, struck, capture_speed * fastest)
    selection = gauss_selection(scene, geometry, t, q, v_after, closed, slowest)
    after = _with_selection(mode, selection, gap)
    kind = jnp.where(is_release, EventKind.RELEASE, jnp.where(after.active[event], EventKind.CAPTURE, EventKind.IMPACT))
    hop = _hop(scene, t, q, v_after, gap_acceleration, struck & ~after.held)
    return Decision(after, kind, ImpactDetail(support, plastic, settled), grazing, hop=hop)


def _settle(scene: AbstractScene, geometry: ContactGeometry, t, q, v, mode: ContactMode, active, struck, slow):
    """Contacts that an impact leaves with a rate too slow to matter though all of them together are pressed.

    An impact at one contact kicks its neighbours off, they fall back and kick it off: a cascade between contacts, which
    is cut like that of one: rates below `slow`, or hops below the rounding of the gap, become 0. Returns them, and v.
    """
    nobody = jnp.zeros_like(struck)
    if struck.shape[0] == 1:
        return nobody, v
    _, rate = gap_and_rate(scene, t, q, v)
    falls = _gap_acceleration(scene, geometry, t, q, v, dataclasses.replace(mode, active=active))
    unseen = jnp.sqrt(4 * rounding(q.dtype) * jnp.abs(falls) * mode.length)
    limit = jnp.maximum(jnp.maximum(slow, unseen), closeness(q.dtype) * mode.speed)
    together = gauss_selection(scene, geometry, t, q, v, struck, limit).active
    settled = jnp.where(jnp.any(together & ~active), together, nobody)
    return settled, v + geometry.mobility @ settling_impulse(geometry, rate, settled)


def initial_mode(scene: AbstractScene, t, q, v, atol) -> ContactMode:
    """Contacts that the initial state holds closed: Phi = 0 and Phi' = 0 up to rounding, chosen by (T2).

    `atol` is the caller's word for a size that does not matter: it gives a scale to a scene that rests at the origin.
    """
    gap, _ = gap_and_rate(scene, t, q, v)
    geometry = contact_geometry(scene, t, q)
    floor = float(jnp.finfo(q.dtype).eps) ** (-1 / 3) * atol * jnp.sum(jnp.abs(geometry.jacobian), axis=1)
    zero = jnp.zeros_like(gap)
    mode = _wider_scales(ContactMode(jnp.zeros(gap.shape, bool), zero, zero, zero, floor, floor), geometry, q, v)
    if not scene.sustained_contact:
        return mode
    closed = gap <= gap_tolerance(mode.length)
    selection = gauss_selection(scene, geometry, t, q, v, closed, closeness(q.dtype) * mode.speed)
    return _with_selection(mode, selection, gap)


def _gap_acceleration(scene: AbstractScene, geometry: ContactGeometry, t, q, v, mode: ContactMode):
    """Phi'' = G^T v' + gamma, as the motion was before the event."""
    _, bias = gap_rate_and_bias(scene, t, q, v)
    return geometry.jacobian @ acceleration(scene, t, q, v, mode.active) + bias


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


def _wider_scales(mode: ContactMode, geometry: ContactGeometry, q, v) -> ContactMode:
    size = jnp.abs(geometry.jacobian)
    length, speed = jnp.maximum(mode.length, size @ jnp.abs(q)), jnp.maximum(mode.speed, size @ jnp.abs(v))
    return dataclasses.replace(mode, length=length, speed=speed)


def _with_selection(mode: ContactMode, selection: Selection, gap) -> ContactMode:
    margin = jnp.where(selection.resting, gap_tolerance(mode.length), 0)
    held_gap = jnp.where(mode.active, mode.held_gap, jnp.maximum(gap, 0))
    return dataclasses.replace(mode, active=selection.active, margin=margin, held_gap=lax.stop_gradient(held_gap))
