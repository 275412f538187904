"""Motion inside a mode: accelerations with the multipliers of the closed contacts eliminated (T1)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from .contact import Among, among_held, contact_geometry, gap_and_rate, gap_rate_and_bias
from .mass import solve_mass
from .scene import AbstractScene


def free_acceleration(scene: AbstractScene, t, q, v) -> Float[Array, "dof"]:
    """M^-1 F: the acceleration with every contact open."""
    return solve_mass(scene.mass_matrix(q), scene.force(t, q, v))


def contact_multiplier(
    scene: AbstractScene, t, q, v, free: Float[Array, "dof"], active: Bool[Array, "contact"]
) -> tuple[Float[Array, "contact"], Float[Array, "dof"]]:
    """Multipliers of the active contacts, given M^-1 F, and what they add to the acceleration.

    W_AA lambda_A = -(G_A^T M^-1 F + gamma_A),   v' = M^-1 (F + G_A lambda_A)   (T1); lambda = 0 outside A.
    """

    def among(scene, active):
        geometry = contact_geometry(scene, t, q)
        _, bias = gap_rate_and_bias(scene, t, q, v)
        gap_acceleration = geometry.jacobian @ free + bias
        multiplier = geometry.delassus.solve(-gap_acceleration, active.astype(q.dtype))
        return multiplier, geometry.mobility @ multiplier

    return among_held(scene, active, q.shape[0], Among(among, active, jnp.zeros(active.shape, q.dtype)))


def acceleration(scene: AbstractScene, t, q, v, active: Bool[Array, "contact"]) -> Float[Array, "dof"]:
    """v' in a mode. While every contact is open, only M^-1 F is evaluated."""
    free = free_acceleration(scene, t, q, v)
    if not scene.sustained_contact or active.shape[0] == 0:
        return free
    return free + lax.cond(
        jnp.any(active),
        lambda: contact_multiplier(scene, t, q, v, free, active)[1],
        lambda: jnp.zeros_like(free),
    )


def multipliers(scene: AbstractScene, t, q, v, active: Bool[Array, "contact"]) -> Float[Array, "contact"]:
    """lambda(t, q, v) of the active contacts, 0 for the others."""
    return contact_multiplier(scene, t, q, v, free_acceleration(scene, t, q, v), active)[0]


def multipliers_and_rates(scene: AbstractScene, t, q, v, active: Bool[Array, "contact"]):
    """lambda and its rate along the motion, d lambda / dt = lambda_t + lambda_q v + lambda_v v'."""

    def both(t, q, v):
        free = free_acceleration(scene, t, q, v)
        multiplier, held = contact_multiplier(scene, t, q, v, free, active)
        return multiplier, free + held

    (multiplier, a), rates = jax.linearize(both, t, q, v)
    return multiplier, rates(jnp.ones_like(t), v, a)[0]


class Projected(NamedTuple):
    """A state on its constraints, and how far off them it was."""

    q: Float[Array, "dof"]
    v: Float[Array, "dof"]
    gap_error: Float[Array, "contact"]
    """Phi_A - held gap before; 0 for other contacts."""
    rate_error: Float[Array, "contact"]
    """Phi'_A before."""


def project_to_contacts(
    scene: AbstractScene, t, q, v, active: Bool[Array, "contact"], held_gap: Float[Array, "contact"]
) -> Projected:
    """The nearest state (in the kinetic metric, one Newton iteration each) with Phi_A = held gap and Phi'_A = 0.

    Without it the index-reduced equations (T1) let a held gap drift off by the integration error.
    """

    def among(scene, given):
        active, held_gap = given
        members = active.astype(q.dtype)
        geometry = contact_geometry(scene, t, q)
        gap_error = jnp.where(active, scene.gap(t, q) - held_gap, 0)
        moved = q - geometry.mobility @ geometry.delassus.solve(gap_error, members)
        _, rate = gap_and_rate(scene, t, moved, v)  # what the geometry changed meanwhile is of second order
        rate_error = jnp.where(active, rate, 0)
        turned = v - geometry.mobility @ geometry.delassus.solve(rate_error, members)
        return (gap_error, rate_error), (moved, turned)

    nothing = jnp.zeros(active.shape, q.dtype)
    among_them = Among(among, (active, held_gap), (nothing, nothing))
    errors, moved = among_held(scene, active, q.shape[0], among_them)
    return Projected(*moved, *errors)
