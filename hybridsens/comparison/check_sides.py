"""Does a derivative hold on both sides? Where other events happen from this very point on, it may hold on one alone."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .check_doubts import ONE_SIDED
from .check_motions import Call, on_sequence, same_sequence
from .differentiate import best_finite_differences

STEP = 1e-9
"""Relative: other events that begin within it begin at this very point."""
ROUNDINGS = 64
"""No step is less than so many roundings of a parameter."""


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
