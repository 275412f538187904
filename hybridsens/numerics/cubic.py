"""Where a guard falls through zero inside a step, by the cubic through its end values and rates."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from .tolerances import rounding

UNSURE = 0.01
"""How far a guard's cubic may be from the guard itself, relative to the end values that it is made from."""


def first_falling_root(
    g0: Float[Array, "guard"],
    d0: Float[Array, "guard"],
    g1: Float[Array, "guard"],
    d1: Float[Array, "guard"],
    noise: Float[Array, "guard"],
) -> tuple[Float[Array, "guard"], Float[Array, "guard"]]:
    """First s in (0, 1] at which c(s) falls through zero, and by how much c misses zero; inf where it does neither.

    c is the cubic with c(0) = g0 >= 0, c'(0) = d0, c(1) = g1, c'(1) = d1 (rates times the step), known up to
    `noise`. It is looked at inside as well as at its end: a guard that dips below zero and comes back within the step
    is found too. A minimum that stays above zero by less than the cubic can tell is returned as well: a step that ends
    there decides. Nothing is solved for where no guard can fall: a cubic lies in the hull of its four Bezier points.
    """
    narrow = g1 < UNSURE * (jnp.abs(g0) + jnp.abs(d0) + jnp.abs(d1))
    below = (g0 + d0 / 3 < 0) | (g1 - d1 / 3 < 0) | narrow
    never = jnp.full_like(g0, jnp.inf)
    found = lambda: [jnp.where(below, s, never) for s in _falling_root(g0, d0, g1, d1, noise)]
    root, miss = lax.cond(jnp.any(below), found, lambda: [never, never])
    return root, miss


def _falling_root(g0, d0, g1, d1, noise):
    a = 3 * (g1 - g0) - 2 * d0 - d1
    b = d0 + d1 - 2 * (g1 - g0)
    value = lambda s: g0 + s * (d0 + s * (a + s * b))
    slope = lambda s: d0 + s * (2 * a + s * 3 * b)
    minimum, maximum = _stationary_points(a, b, d0)
    size = jnp.abs(g0) + jnp.abs(g1) + jnp.abs(d0) + jnp.abs(d1)
    dips = (minimum > 0) & (minimum < 1) & (value(jnp.clip(minimum, 0, 1)) < -(rounding(g0.dtype) * size + noise))
    high = jnp.where(dips, minimum, 1.0)
    low = jnp.where((maximum > 0) & (maximum < high), maximum, 0.0)
    root = _monotone_root(value, slope, low, high)
    root = jnp.where(dips | (g1 < 0), root, jnp.inf)
    missed = (g0 > noise) & (g1 >= 0) & ~dips
    near_miss = missed & (minimum > 0.01) & (minimum < 0.99) & (value(minimum) < UNSURE * size)
    at_hand = missed & (minimum > -0.02) & (minimum < 1.02)  # also where a step was made to end at the minimum
    miss = jnp.where(at_hand, value(jnp.clip(minimum, 0, 1)), jnp.inf)
    return jnp.where(near_miss, minimum, root), miss


def hides_a_dip(
    g0: Float[Array, "guard"],
    d0: Float[Array, "guard"],
    g1: Float[Array, "guard"],
    d1: Float[Array, "guard"],
    noise: Float[Array, "guard"],
) -> Bool[Array, "guard"]:
    """Guards for which a step is so long that the cubic could be missing a dip below zero.

    The error control knows nothing of a guard that depends on time (free flight over a shaking table is exact at any
    step). What a guard's third derivative does over the step, |g1 - g0 - (d0 + d1) / 2|, must stay below the cubic
    itself.
    """
    bend = jnp.abs(g1 - g0 - (d0 + d1) / 2)
    inside = inside_of_cubic(g0, d0, g1, d1)
    lowest = jnp.minimum(jnp.minimum(inside[0], inside[1]), inside[2])
    rounded = rounding(g0.dtype) * (jnp.abs(g0) + jnp.abs(g1) + jnp.abs(d0) + jnp.abs(d1)) + noise
    # A guard that is just being left is small at first for a good reason: only its end can be compared.
    clearance = jnp.where(g0 <= rounded, g1, lowest / 2)
    return (bend > clearance) & (bend > rounded)


def inside_of_cubic(g0, d0, g1, d1) -> list[Float[Array, "guard"]]:
    """c(1/4), c(1/2) and c(3/4)."""
    a, b = 3 * (g1 - g0) - 2 * d0 - d1, d0 + d1 - 2 * (g1 - g0)
    return [g0 + s * (d0 + s * (a + s * b)) for s in (0.25, 0.5, 0.75)]


def tangents_meet_below(
    g0: Float[Array, "guard"],
    d0: Float[Array, "guard"],
    g1: Float[Array, "guard"],
    d1: Float[Array, "guard"],
    noise: Float[Array, "guard"],
) -> Float[Array, "guard"]:
    """Where the tangents at both ends of a step meet, if that is below zero; inf elsewhere.

    A convex guard lies above its tangents, so one that meets a tip or a thin body dips below zero near there. The cubic
    cannot know: that of |s - 1/2| stays above 1/4.
    """
    valley = (d0 < 0) & (d1 > 0) & (g0 > noise) & (g1 > noise)
    s = (g1 - d1 - g0) / jnp.where(valley, d0 - d1, 1)
    return jnp.where(valley & (g0 + s * d0 < -noise) & (s > 0.01) & (s < 0.99), s, jnp.inf)


def _stationary_points(a, b, d0):
    """The local minimum and maximum of the cubic, each in the form that does not cancel; nan where there is none."""
    root = jnp.sqrt(a * a - 3 * b * d0)
    minimum = jnp.where(a > 0, -d0 / (a + root), (root - a) / (3 * b))
    maximum = jnp.where(a > 0, -(a + root) / (3 * b), d0 / (root - a))
    return minimum, maximum


def _monotone_root(value, slope, low, high, iterations: int = 6):
    """Root of a function that falls from `low` to `high`: Newton's method, and the chord where that leaves its bracket.

    A chord, since half the bracket never gets to a root that lies close to an end: a landing aims at such a one."""

    def body(_, carry):
        s, low, high, at_low, at_high = carry
        c = value(s)
        low, at_low = jnp.where(c >= 0, s, low), jnp.where(c >= 0, c, at_low)
        high, at_high = jnp.where(c < 0, s, high), jnp.where(c < 0, c, at_high)
        newton = s - c / slope(s)
        inside = (newton >= low) & (newton <= high)
        fall = at_low - at_high
        chord = low + (high - low) * jnp.clip(at_low / jnp.where(fall > 0, fall, 1), 0, 1)
        return jnp.where(inside, newton, chord), low, high, at_low, at_high

    return lax.fori_loop(0, iterations, body, (0.5 * (low + high), low, high, value(low), value(high)))[0]
