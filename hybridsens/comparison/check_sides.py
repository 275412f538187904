"""Does a derivative hold on both sides? Where other events happen from this very point on, it may hold on one alone;
where J has a kink at it, on none."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .check_motions import Call, on_sequence, same_sequence
from .check_report import KINK, ONE_SIDED
from .differentiate import best_finite_differences

STEP = 1e-9
"""Relative: other events that begin within it begin at this very point."""
ROUNDINGS = 64
"""No step is less than so many roundings of a parameter."""
KINK_WIDTHS = (2.5e-4, 6e-5, 1.5e-5)
"""Relative, some of those of finite differences."""
CONSTANT = 0.1
"""Relative: how far what a kink makes of the slopes may change from width to width. What curvature makes of them falls
like h^3 (by 64 or more), what noise does grows like 1 / h (by 4)."""


class OtherSide(NamedTuple):
    """What J is on a side of a point where other events happen."""

    jump: float
    """J there less J at the point."""
    slope: float
    """Its derivative there, by differences; nan where these do not tell."""
    uncertainty: float
    step: float
    """How far from the point this was found."""


def other_side(
    value: Callable, J: float, calls: tuple[Call, ...], vector: Float[np.ndarray, "parameter"], entry: tuple[int, float]
) -> OtherSide | None:
    """What is known of the side of `vector` on which other events happen; None where there is no such side.

    `value` returns J and its motions, as these `calls` at `vector`. The entry of a number is moved in units of a scale.
    """
    i, scale = entry
    for sign in (1.0, -1.0):
        beside = np.array(vector)
        beside[i] += sign * scale * max(STEP, ROUNDINGS * float(np.finfo(beside.dtype).eps))
        J_beside, calls_beside = value(jnp.asarray(beside))
        reached = all(bool(call.status.reached_end) for call in calls_beside)
        if reached and not all(map(same_sequence, calls_beside, calls)):
            slope, uncertainty = _slope(on_sequence(value, calls_beside), beside, i, scale)
            return OtherSide(float(J_beside) - J, slope, uncertainty, abs(float(beside[i] - vector[i])))
    return None


def kink_at(
    function: Callable, vector: Float[np.ndarray, "parameter"], entry: tuple[int, float], least: float
) -> tuple[float, float] | None:
    """The slopes of J on the left and on the right of a kink at `vector`; None where it has none that is > `least`.

    The middle of both is what central differences find there, and what JAX gives for `maximum` and `abs`.
    """
    i, scale = entry
    unit = np.zeros_like(vector)
    unit[i] = 1
    middle, found = function(vector), []
    # Of second order on each side: on a smooth J both have the same error but for O(h^3).
    slope = lambda h: (4 * function(vector + h * unit) - function(vector + 2 * h * unit) - 3 * middle) / (2 * h)
    for width in KINK_WIDTHS:
        left, right = slope(-width * scale), slope(width * scale)
        if abs(right - left) <= least:
            return None
        if np.isfinite(right - left):
            found.append((left, right))
    change = np.array([right - left for left, right in found])
    if change.size < 2 or np.any(np.abs(np.diff(change)) > CONSTANT * abs(change[-1])):
        return None
    return found[-1]


def kinked(sides: tuple[float, float] | None, found: tuple[float, ...], limit: float) -> str:
    """The verdict on slopes that were found where J has these ones on its sides; empty where it has no kink, and where
    one that was found is not among them nor between."""
    if sides is None or not all(min(sides) - limit <= slope <= max(sides) + limit for slope in found):
        return ""
    left, right = (slope + 0.0 for slope in sides)  # no "-0"
    return f"{KINK}, with slope {left:.6g} on its left and {right:.6g} on its right"


def _slope(function: Callable, vector: Float[np.ndarray, "parameter"], i: int, scale: float) -> tuple[float, float]:
    """The derivative by one entry, and its uncertainty."""

    def of_entry(entry):
        moved = np.array(vector)
        moved[i] = entry[0]
        return function(moved)

    found = best_finite_differences(of_entry, vector[i : i + 1], np.array([scale]))
    return float(found.slopes[0]), float(found.uncertainty[0])


def one_sided(side: OtherSide | None, slope: float, limit: float, least_jump: float) -> str:
    """The verdict on a slope of one side, in view of the other one: empty where that has the same J and slope.

    `limit` is how far slopes may be apart, `least_jump` what J may change by for its rounding."""
    if side is None:
        return ""
    if abs(side.jump) > least_jump + 10 * abs(slope) * side.step:
        return f"{ONE_SIDED}: for the least change other events happen, and J jumps by {side.jump:.3g}"
    if np.isnan(side.slope):
        return f"{ONE_SIDED}: for the least change other events happen"
    slope_there = 0.0 if abs(side.slope) <= limit + side.uncertainty else side.slope
    if abs(slope_there - slope) > limit + 3 * side.uncertainty:
        return f"{ONE_SIDED}: for the least change other events happen, and the derivative is {slope_there:.6g}"
    return ""
