"""Which contacts act: Gauss's principle for forces (T2), Newton-Moreau's law for impulses (T3)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..precision import closeness
from ..short import product
from .complementarity import complementarity_support
from .contact import ContactGeometry, gap_and_rate, gap_rate_and_bias
from .dense import solve_masked
from .flow import free_acceleration
from .scene import AbstractScene


class Selection(NamedTuple):
    """Outcome of Gauss's principle among closed contacts."""

    active: Bool[Array, "contact"]
    """Contacts with lambda_i > 0."""
    resting: Bool[Array, "contact"]
    """Closed contacts with lambda_i = 0 that do not open either: redundant, or touching without force."""


def impact_impulse(
    geometry: ContactGeometry, rate, restitution, support: Bool[Array, "contact"]
) -> Float[Array, "contact"]:
    """Impulses P with phi'+ = -e phi'- on the support: W_SS P_S = -(1 + e) phi'-_S, the equality part of (T3)."""
    return solve_masked(geometry.delassus_matrix, -(1 + restitution) * rate, support.astype(rate.dtype))


def settling_impulse(geometry: ContactGeometry, rate, settled: Bool[Array, "contact"]) -> Float[Array, "contact"]:
    """Impulses with phi'+ = 0 on the settled contacts, of either sign."""
    return solve_masked(geometry.delassus_matrix, -rate, settled.astype(rate.dtype))


def transition_impulse(
    geometry: ContactGeometry, rate, restitution, support: Bool[Array, "contact"], settled: Bool[Array, "contact"]
) -> Float[Array, "contact"]:
    """All impulses of an event: those of the impact, then those that bring the settled contacts to rest."""
    impulse = impact_impulse(geometry, rate, restitution, support)
    if rate.shape[0] == 1:  # one contact has no neighbour to settle with
        return impulse
    return impulse + settling_impulse(geometry, rate + geometry.delassus_matrix @ impulse, settled)


def impulse_support(
    geometry: ContactGeometry, rate, restitution, closed: Bool[Array, "contact"], speed
) -> Bool[Array, "contact"]:
    """Contacts whose impulse is positive in (T3): 0 <= P _|_ phi'+ + E phi'- >= 0 on the closed contacts.

    `speed` (contact,) is what rounding in the rates is relative to."""
    noise = closeness(rate.dtype) * speed
    return complementarity_support(geometry.delassus_matrix, (1 + restitution) * rate, closed, noise)


def gauss_selection(
    scene: AbstractScene, geometry: ContactGeometry, t, q, v, closed: Bool[Array, "contact"], slowest
) -> Selection:
    """Gauss's principle (1.4)-(1.5) as (T2) on the contacts that are closed and have no rate.

    0 <= lambda _|_ W lambda + G^T M^-1 F + gamma >= 0; a rate up to `slowest` (contact,) counts as none.
    """
    _, rate = gap_and_rate(scene, t, q, v)
    tolerance = closeness(q.dtype)
    still = closed & (jnp.abs(rate) <= slowest)
    free = free_acceleration(scene, t, q, v)
    _, bias = gap_rate_and_bias(scene, t, q, v)
    gap_acceleration = product(geometry.jacobian, free) + bias
    noise = tolerance * (product(jnp.abs(geometry.jacobian), jnp.abs(free)) + jnp.abs(bias))
    active = complementarity_support(geometry.delassus_matrix, gap_acceleration, still, noise)
    multiplier = solve_masked(geometry.delassus_matrix, -gap_acceleration, active.astype(q.dtype))
    left_over = gap_acceleration + product(geometry.delassus_matrix, multiplier)
    return Selection(active, still & ~active & (left_over <= noise))
