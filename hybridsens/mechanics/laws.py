"""Which contacts act: Gauss's principle for forces (T2), Newton-Moreau's law for impulses (T3)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics.tolerances import closeness
from .complementarity import complementarity_support
from .contact import ContactGeometry, gap_rate_and_bias
from .delassus import Delassus
from .flow import free_acceleration
from .scene import AbstractScene


class Selection(NamedTuple):
    """Outcome of Gauss's principle among closed contacts."""

    active: Bool[Array, "contact"]
    """Contacts with lambda_i > 0."""
    resting: Bool[Array, "contact"]
    """Closed contacts with lambda_i = 0 that do not open either: redundant, or touching without force."""


class TransitionImpulse(NamedTuple):
    """All impulses of an event."""

    impact: Float[Array, "contact"]
    """Those of the impact."""
    settling: Float[Array, "contact"] | None
    """Those, of either sign, that bring neighbours to rest after it."""
    settling_energy: Float[Array, ""] | None
    """Twice the kinetic energy of what they change, |M^-1 G P|^2 in the kinetic metric [J]."""

    @property
    def total(self) -> Float[Array, "contact"]:
        """Their sum."""
        return self.impact if self.settling is None else self.impact + self.settling


def transition_impulse(
    geometry: ContactGeometry,
    rate,
    restitution,
    support: Bool[Array, "contact"],
    brought_to_rest: Bool[Array, "contact"] | None = None,
) -> TransitionImpulse:
    """All impulses of an event. First those of the impact, with phi'+ = -e phi'- on the support: W_SS P_S =
    -(1 + e) phi'-_S, the equality part of (T3). Then those with phi'+ = 0 on the contacts brought to rest, where there
    can be any."""
    W = geometry.delassus
    impact = W.solve(-(1 + restitution) * rate, support.astype(rate.dtype))
    if brought_to_rest is None:
        return TransitionImpulse(impact, None, None)
    left = rate + W @ impact
    settling = W.solve(-left, brought_to_rest.astype(rate.dtype))
    return TransitionImpulse(impact, settling, -settling @ left)


def impulse_support(
    geometry: ContactGeometry, rate, restitution, closed: Bool[Array, "contact"], speed
) -> Bool[Array, "contact"]:
    """Contacts whose impulse is positive in (T3): 0 <= P _|_ phi'+ + E phi'- >= 0 on the closed contacts.

    `speed` (contact,) is what rounding in the rates is relative to."""
    noise = closeness(rate.dtype) * speed
    return complementarity_support(geometry.delassus, (1 + restitution) * rate, closed, noise)


class GapAcceleration(NamedTuple):
    """Phi'' of every contact with all of them open, G^T M^-1 F + gamma [m/s^2]."""

    free: Float[Array, "contact"]
    noise: Float[Array, "contact"]
    """What rounding leaves in it."""

    def held(self, W: Delassus, active: Bool[Array, "contact"]) -> Float[Array, "contact"]:
        """Phi'' where the active contacts are held, by (T1): free + W lambda."""
        return self.free + W @ self.multiplier(W, active)

    def multiplier(self, W: Delassus, active: Bool[Array, "contact"]) -> Float[Array, "contact"]:
        """lambda of the active contacts (T1)."""
        return W.solve(-self.free, active.astype(self.free.dtype))


def gap_acceleration(scene: AbstractScene, geometry: ContactGeometry, t, q, v) -> GapAcceleration:
    """Phi'' = G^T v' + gamma with v' = M^-1 F."""
    free = free_acceleration(scene, t, q, v)
    _, bias = gap_rate_and_bias(scene, t, q, v)
    size = jnp.abs(geometry.jacobian) @ jnp.abs(free) + jnp.abs(bias)
    return GapAcceleration(geometry.jacobian @ free + bias, closeness(q.dtype) * size)


def gauss_selection(W: Delassus, acceleration: GapAcceleration, still: Bool[Array, "contact"]) -> Selection:
    """Gauss's principle (1.4)-(1.5) as (T2) on the contacts that are closed and have no rate, those `still`:

    0 <= lambda _|_ W lambda + G^T M^-1 F + gamma >= 0.
    """
    active = complementarity_support(W, acceleration.free, still, acceleration.noise)
    multiplier = acceleration.multiplier(W, active)
    noise = acceleration.noise + closeness(multiplier.dtype) * W.sizes(multiplier)
    return Selection(active, still & ~active & (acceleration.free + W @ multiplier <= noise))
