"""Sizes below which a difference counts as rounding."""

import jax.numpy as jnp


def closeness(dtype) -> float:
    """Relative size below which a guard or a rate counts as zero: eps^(2/3), 4e-11 in float64."""
    return float(jnp.finfo(dtype).eps) ** (2 / 3)


def rounding(dtype) -> float:
    """Relative size of what evaluating a guard leaves: 8 eps."""
    return 8 * float(jnp.finfo(dtype).eps)


MOST_RELAXED = 5
"""1e-12 of what the clock shows. More would be a second at 1e8 s: events came before their guards fell."""

AT_END = 1
"""An event by less than `time_resolution(t, 1)` before the end of a solve is not told from that end: so long is the
shortest step."""


def time_resolution(t, relaxation):
    """How exactly an event can be placed in time: 4 units in the last place, times 4^relaxation.

    Event location relaxes it with every step that it shortens, so that it ends also where rounding in the guard is
    worse than in time; up to `MOST_RELAXED`, where it is counted in a compiled program."""
    spacing = jnp.finfo(t.dtype).eps * jnp.abs(t) + jnp.finfo(t.dtype).tiny
    if isinstance(relaxation, int):
        return 4.0 ** (1 + relaxation) * spacing
    return 4 * spacing * jnp.left_shift(1, 2 * jnp.minimum(relaxation, MOST_RELAXED)).astype(t.dtype)


def jump_length(t):
    """How long the clock takes to pass a jump time, which lies in the middle: forces are evaluated on both sides."""
    return 4 * time_resolution(t, 0)


def jump_window(t):
    """What came by so much before t may have come while the clock passed a jump time: half as much again for
    rounding."""
    return 1.5 * jump_length(t)
