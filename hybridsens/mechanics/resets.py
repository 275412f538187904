"""What happens at an event: who takes part, which law acts, who is held afterwards."""

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ..hybrid import Decision
from .contact import ContactGeometry, contact_geometry, contact_jacobian, gap_and_rate, gap_rate_and_bias
from .flow import acceleration
from .laws import Selection, gauss_selection, impact_impulse, impulse_support
from .mode import ContactMode, EventKind, closeness
from .scene import AbstractScene


class ImpactDetail(eqx.Module):
    """What `reset` has to know of a decision."""

    support: Bool[Array, "contact"]
    """Contacts whose impulse is positive; none at a release, whose reset is then the identity."""
    plastic: Bool[Array, "contact"]
    """Contacts that are captured: their restitution counts as 0."""


def decide_transition(scene: AbstractScene, capture_speed: float, event, t, q, v, mode: ContactMode) -> Decision:
    """The discrete outcome of guard `event` falling through zero at (t, q, v-)."""
    geometry = contact_geometry(scene, t, q)
    gap, rate = gap_and_rate(scene, t, q, v)
    fired = jnp.arange(gap.shape[0]) == event
    is_release = mode.active[event]
    closed = jnp.where(is_release, mode.held & ~fired, mode.held | fired | _touching(geometry, event, gap, q))
    struck = closed & ~is_release
    fastest = jnp.where(struck, jnp.maximum(mode.fastest, -rate), mode.fastest)
    e = scene.restitution()

    def impact(plastic):
        restitution = jnp.where(plastic, 0, e)
        support = impulse_support(geometry, rate, restitution, struck, v)
        return support, v + geometry.mobility @ impact_impulse(geometry, rate, restitution, support)

    if not scene.sustained_contact:
        plastic = jnp.zeros_like(closed)
        support, _ = impact(plastic)
        after = ContactMode(mode.active, mode.margin, fastest)
        return Decision(after, jnp.asarray(EventKind.IMPACT), ImpactDetail(support, plastic))

    # A rebound too slow to matter is plastic, but only where the contact is pressed together: a grazing contact
    # leaves slowly too, and has to keep its rebound. So the law is applied twice: with every slow contact plastic,
    # and with those of them that were held then.
    slow = struck & (e * jnp.maximum(-rate, 0) <= capture_speed * fastest)

    def law(_, carry):
        plastic = carry[3]
        support, v_after = impact(plastic)
        selection = gauss_selection(scene, geometry, t, q, v_after, closed)
        return plastic, support, selection, slow & selection.active

    nobody = jnp.zeros_like(closed)
    plastic, support, selection, _ = lax.fori_loop(0, 2, law, (nobody, nobody, Selection(nobody, nobody), slow))
    after = _mode_after(selection, geometry, q, fastest)
    kind = jnp.where(is_release, EventKind.RELEASE, jnp.where(after.active[event], EventKind.CAPTURE, EventKind.IMPACT))
    return Decision(after, kind, ImpactDetail(support, plastic))


def initial_mode(scene: AbstractScene, t, q, v) -> ContactMode:
    """Contacts that the initial state holds closed: Phi = 0 and Phi' = 0 up to rounding, chosen by (T2)."""
    gap, _ = gap_and_rate(scene, t, q, v)
    if not scene.sustained_contact:
        return ContactMode(jnp.zeros(gap.shape, bool), jnp.zeros_like(gap), jnp.zeros_like(gap))
    geometry = contact_geometry(scene, t, q)
    closed = gap <= gap_tolerance(geometry, q)
    selection = gauss_selection(scene, geometry, t, q, v, closed)
    return _mode_after(selection, geometry, q, jnp.zeros_like(gap))


def is_grazing(scene: AbstractScene, event, t, q, v, mode: ContactMode, depth) -> Bool[Array, ""]:
    """Whether an impact is as shallow as `depth`: without the contact the gap would turn back at -Phi'^2 / (2 Phi'')."""
    rate, bias = gap_rate_and_bias(scene, t, q, v)
    a = acceleration(scene, t, q, v, mode.active)
    gap_acceleration = contact_jacobian(scene, t, q)[event] @ a + bias[event]
    turns_back = ~mode.active[event] & (gap_acceleration > 0)
    return turns_back & (rate[event] ** 2 <= 2 * gap_acceleration * depth)


def gap_tolerance(geometry: ContactGeometry, q):
    """Gaps up to this size count as closed: the closeness times |G|^T |q|, so it scales with the scene [m]."""
    return closeness(q.dtype) * (jnp.abs(geometry.jacobian) @ jnp.abs(q)) + jnp.finfo(q.dtype).tiny


def _touching(geometry: ContactGeometry, event, gap, q):
    """Contacts closed at this instant that the struck one acts on; uncoupled ones have an event of their own."""
    W = geometry.delassus_matrix
    size = jnp.sqrt(jnp.abs(jnp.diag(W) * W[event, event]))
    coupled = jnp.abs(W[event]) > closeness(q.dtype) * size
    return coupled & (gap <= gap_tolerance(geometry, q))


def _mode_after(selection: Selection, geometry: ContactGeometry, q, fastest) -> ContactMode:
    margin = jnp.where(selection.resting, gap_tolerance(geometry, q), 0)
    return ContactMode(selection.active, margin, fastest)
