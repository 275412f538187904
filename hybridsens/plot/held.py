"""Which contacts are closed at the states of a motion, and the forces of those that are held."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..mechanics.contact import Instant, contact_geometry, contact_jacobian, gap_and_rate
from ..mechanics.event_state import MEETING
from ..mechanics.laws import gap_acceleration, gauss_selection
from ..mechanics.scene import AbstractScene
from ..mechanics.switches import in_mode
from ..numerics.tolerances import closeness, time_resolution

MUCH = 10
"""So many times what counts as zero, relative to the largest that a contact shows, is zero in a picture."""
LEAST = 1e-12
"""And so is what is smaller than this [m, m/s]: a body that only rests shows nothing to compare with."""


def closed_contacts(scene: AbstractScene, rows: Instant) -> Bool[Array, "row contact"]:
    """Contacts whose gap and its rate are zero to rounding at states (row, dof). Between two impacts, however close,
    the rate is not."""

    def sizes(t, q, v):
        (gap, rate), J = gap_and_rate(scene, t, q, v), jnp.abs(contact_jacobian(scene, t, q))
        return gap, rate, J @ jnp.abs(q) + jnp.abs(gap), J @ jnp.abs(v) + jnp.abs(rate)

    gap, rate, length, speed = jax.vmap(sizes)(*rows)
    zero = MUCH * closeness(gap.dtype)
    largest = lambda of_rows: jnp.max(of_rows, axis=0, initial=0)
    misplaced = time_resolution(rows.t, MEETING)[:, None] * largest(speed)
    shut = jnp.abs(gap) <= zero * largest(length) + misplaced + LEAST
    return shut & (jnp.abs(rate) <= zero * largest(speed) + LEAST)


def held_forces(
    scene: AbstractScene, rows: Instant, held_at_end: Bool[Array, "contact"], modes: Any
) -> Float[Array, "row contact"]:
    """lambda at each state, of the closed contacts that Gauss's principle (T2) holds there; 0 for others. `modes` are
    those of a scene with switches (row); None for another one.

    Where it leaves a choice, as among the four feet of a table, those that were held at the row before go on, first
    those `held_at_end`."""
    if not scene.sustained_contact:
        return jnp.zeros((rows.t.shape[0], held_at_end.shape[0]), rows.q.dtype)

    def forces_at(before, row):
        now, mode, closed = row
        moving, _ = in_mode(scene, None, mode)
        geometry = contact_geometry(moving, now.t, now.q)
        acceleration, W = gap_acceleration(moving, geometry, *now), geometry.delassus
        before = before & closed
        force = acceleration.multiplier(W, before)
        pressed = ~before | (force * W.diagonal() >= -acceleration.noise)
        in_place = before | ~closed | (acceleration.free + W @ force >= -acceleration.noise)

        def chosen():
            active = gauss_selection(W, acceleration, closed).active
            return active, acceleration.multiplier(W, active)

        active, force = lax.cond(jnp.all(pressed & in_place), lambda: (before, force), chosen)
        return active, jnp.where(active, jnp.maximum(force, 0), 0)

    return lax.scan(forces_at, held_at_end, (rows, modes, closed_contacts(scene, rows)))[1]
