"""Gaps that are not smooth where it matters: told when a motion cannot go on there."""

import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..numerics.tolerances import closeness, time_resolution
from .contact import gap_and_rate
from .mode import ContactMode, gap_tolerance
from .scene import AbstractScene

WIDER = 16
"""Ratio of the two distances at which a gap is looked at."""


def has_jumped(guard, rate, length, t) -> Bool[Array, ""]:
    """Whether a guard that should be 0 at an impact is far below: farther than the resolution of time explains."""
    return guard < -(gap_tolerance(length) + time_resolution(t, 12) * jnp.abs(rate))


def is_not_smooth(scene: AbstractScene, t, q, v, mode: ContactMode) -> Bool[Array, ""]:
    """Whether a held gap, or its rate, jumps just ahead of (t, q, v).

    The change over a short distance h, by more than the rate explains, is of the order of h where the gap is smooth
    (of h^2 for the gap itself), and as large at h / 16 as at h where it jumps.
    """
    near = jnp.finfo(q.dtype).eps ** 0.6 * jnp.abs(t)
    gap, rate = gap_and_rate(scene, t, q, v)

    def changes(h):
        ahead, rate_ahead = gap_and_rate(scene, t + h, q + h * v, v)
        return jnp.abs(ahead - gap - h * rate), jnp.abs(rate_ahead - rate)

    scales = gap_tolerance(mode.length), closeness(q.dtype) * mode.speed
    jumps = [
        (close > far / 4) & (close > 4 * scale)
        for close, far, scale in zip(changes(near), changes(WIDER * near), scales, strict=True)
    ]
    return jnp.any(mode.active & (jumps[0] | jumps[1]))
