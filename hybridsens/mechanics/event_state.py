"""The contacts that take part in an event, and what is known of them before any law acts."""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics.tolerances import closeness, rounding, time_resolution
from .contact import ContactGeometry, Instant, contact_geometry, gap_and_rate
from .laws import gap_acceleration
from .mode import ContactMode, Limits
from .scene import AbstractScene

MEETING = 2
"""How far the location of an event may have been relaxed (see `time_resolution`) for contacts to count as meeting."""
JUST_BEFORE = 1e-3
"""A contact was struck just before if it has come since, at its fastest, no farther than this part of its length. A
plastic one opens by its acceleration alone: in sqrt(closeness), 6e-6, of its time it is no farther than what counts as
closed."""


class EventState(NamedTuple):
    """What is known at an event before any law acts."""

    geometry: ContactGeometry
    gap: Float[Array, "contact"]
    rate: Float[Array, "contact"]
    """Phi' just before."""
    gap_acceleration: Float[Array, "contact"]
    """Phi'' as the motion was before."""
    triggered: Bool[Array, "contact"]
    """The contact whose guard fell through zero; none at the start or at a flow jump."""
    meeting: Bool[Array, "contact"]
    """Contacts whose gap is zero at this instant, whether or not the triggered one acts on them."""
    closed: Bool[Array, "contact"]
    """Contacts that take part: held ones, the triggered one, and those that meet here and that it reaches."""
    impacting: Bool[Array, "contact"]
    """Those of them that the law of impact is asked about: none at a release, at the start or at a flow jump."""
    below_rounding: Float[Array, "contact"]
    """Rebounds slower than this hop lower than the rounding of the gap."""
    just_struck: Bool[Array, "contact"]
    """Contacts that were struck just before too; none where there is one contact."""
    in_cascade: Bool[Array, "contact"]
    """Those of them since whose last impact another one was struck."""
    in_turn: Bool[Array, "contact"]
    """Contacts that are as near, but do not meet: they strike in turn with the triggered one."""


def look_at_event(
    scene: AbstractScene, limits: Limits, event, now: Instant, mode: ContactMode
) -> tuple[EventState, ContactMode]:
    """Who meets, and the mode with its memory of sizes brought up to date."""
    t, q, v = now
    geometry = contact_geometry(scene, t, q)
    gap, rate = gap_and_rate(scene, t, q, v)
    accelerations = gap_acceleration(scene, geometry, t, q, v).held(geometry.delassus, mode.active)
    mode = wider_scales(mode, geometry.jacobian, q, v, rate, limits.depth[1])
    tolerance = mode.gap_tolerance(t)
    chosen_anew = event < 0  # at the start and at a flow jump
    triggered = jnp.arange(gap.shape[0]) == event
    is_release = jnp.any(triggered & mode.active)
    near = tolerance + time_resolution(t, MEETING) * jnp.abs(rate)
    just_struck = _just_struck(mode, t)
    in_cascade = just_struck if mode.struck is None else just_struck & mode.struck.before_another
    in_turn = (gap <= near) & _in_turn(triggered, just_struck, rate, limits.capture_speed, mode)
    meeting = (gap <= near) & ~in_turn
    joined = _joined(geometry, triggered, meeting, mode.active)  # others have an event of their own
    held = mode.active | ((mode.margin > 0) & (gap <= 2 * mode.margin))
    closed = jnp.where(is_release, held & ~triggered, held | joined)
    closed = jnp.where(chosen_anew, (gap <= tolerance) | held, closed)
    impacting = closed & ~is_release & ~chosen_anew
    below_rounding = rate_below_rounding(accelerations, t, mode)
    fastest = jnp.where(impacting, jnp.maximum(mode.fastest, -rate), mode.fastest)
    at_event = EventState(
        geometry, gap, rate, accelerations, triggered, meeting, closed, impacting, below_rounding, just_struck,
        in_cascade, in_turn,
    )  # fmt: skip
    struck = None if mode.struck is None else mode.struck.again(impacting, t)
    return at_event, dataclasses.replace(mode, fastest=fastest, struck=struck)


def _just_struck(mode: ContactMode, t) -> Bool[Array, "contact"]:
    if mode.struck is None:
        return jnp.zeros_like(mode.active)
    return (t - mode.struck.time) * mode.speed <= JUST_BEFORE * mode.length


def _in_turn(triggered, just_struck, rate, capture_speed, mode: ContactMode) -> Bool[Array, "contact"]:
    """Contacts that strike in turn with the triggered one, ever faster, as a light body does between two that come
    together: one was struck alone, just before. They are near without meeting, and have an event of their own.

    Contacts that met at their last impact too, as the feet of a plate, meet again; and once both are slow they settle
    together. While one is fast they must not: an impact that is not captured would throw the other off."""
    if mode.struck is None:
        return jnp.zeros_like(triggered)
    alone = mode.struck.number != jnp.max(jnp.where(triggered, mode.struck.number, 0))
    fast = jnp.abs(rate) > capture_speed * mode.fastest
    return ~triggered & ~mode.active & alone & just_struck & (fast | jnp.any(fast & triggered))


def rate_below_rounding(gap_acceleration, t, mode: ContactMode):
    """Rates up to which a contact that falls back hops lower than the rounding of its gap and its margin together. A
    contact that rests without a load has a margin, and a load that then grows presses it through."""
    margin = jnp.where(mode.active, 0, mode.margin)
    height = rounding(mode.length.dtype) * (mode.length + mode.clock_length(t)) + margin
    return jnp.sqrt(4 * jnp.abs(gap_acceleration) * height)


def _joined(geometry: ContactGeometry, triggered, meeting, active) -> Bool[Array, "contact"]:
    """The triggered contact, and those that meet with it and that its impulse reaches: by itself, by what those held do
    then, or by what others do that it has reached."""
    if triggered.shape[0] == 1:
        return triggered
    W, diagonal = geometry.delassus, jnp.abs(geometry.delassus.diagonal())
    # Impulses of several contacts at once, in no simple proportion, so that they do not cancel.
    impulse = 1 + jnp.mod(jnp.sqrt(2.0) * jnp.arange(triggered.shape[0]), 1).astype(diagonal.dtype)

    def grown(reached):
        rates = W @ jnp.where(reached, impulse, 0)
        with_held = rates - W @ W.solve(rates, active.astype(rates.dtype))
        least = closeness(rates.dtype) * jnp.sqrt(diagonal * jnp.max(jnp.where(reached, diagonal, 0)))
        return reached | (meeting & (jnp.maximum(jnp.abs(rates), jnp.abs(with_held)) > least))

    # Nothing is asked where no other contact meets: most impacts are alone.
    goes_on = lambda now: jnp.any(now[1] & ~now[0]) & jnp.any(meeting & ~now[1])
    return lax.while_loop(goes_on, lambda now: (now[1], grown(now[1])), (jnp.zeros_like(triggered), triggered))[1]


def acted_on_nearby(geometry: ContactGeometry, triggered: Bool[Array, "contact"]) -> Bool[Array, "contact"]:
    """The same, here or for other parameters: W is a sum over coordinates, and may be zero because its terms cancel,
    as between the walls of a right angle."""
    diagonal = jnp.abs(geometry.delassus.diagonal())
    of_one = triggered.astype(diagonal.dtype)
    terms = (of_one @ jnp.abs(geometry.jacobian)) @ jnp.abs(geometry.mobility)
    return terms > closeness(diagonal.dtype) * jnp.sqrt(diagonal * (of_one @ diagonal))


def wider_scales(mode: ContactMode, jacobian: Float[Array, "contact dof"], q, v, rate, atol) -> ContactMode:
    """The mode with its scales of gaps and rates brought up to date. `atol`, the caller's word for a size that does not
    matter, sets a floor: so a scene that rests at the origin has scales too. A wall that moves towards a body at rest
    has a rate as well."""
    size = jnp.abs(jacobian)
    floor = float(jnp.finfo(q.dtype).eps) ** (-1 / 3) * atol * jnp.sum(size, axis=1)
    length = jnp.maximum(jnp.maximum(mode.length, floor), size @ jnp.abs(q))
    speed = jnp.maximum(jnp.maximum(mode.speed, floor), jnp.maximum(size @ jnp.abs(v), jnp.abs(rate)))
    wall = None if mode.wall is None else jnp.maximum(mode.wall, jnp.abs(rate - jacobian @ v))
    return dataclasses.replace(mode, length=length, speed=speed, wall=wall)
