"""Finite differences of fourth order: the independent check of a gradient, as good as the function is smooth."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_CENTRAL = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
_BACKWARD = {0: 25 / 12, -1: -48 / 12, -2: 36 / 12, -3: -16 / 12, -4: 3 / 12}
_FORWARD = {-place: -weight for place, weight in _BACKWARD.items()}


def finite_differences(
    function: Callable, theta: Float[np.ndarray, "parameter"], width: float = 3e-4
) -> tuple[Float[np.ndarray, "parameter"], Bool[np.ndarray, "parameter"]]:
    """Derivatives of a scalar function of a vector, and which of them are one-sided.

    df/dtheta_i ~ sum_k w_k f(theta + k h e_i) / h with h = width |theta_i| (width where theta_i = 0), error O(h^4).
    Where the function is not finite on one side of theta, the other side is used; where on neither, the result is nan.
    """
    slopes, one_sided = np.full(theta.shape, np.nan), np.zeros(theta.shape, bool)
    for i, value in enumerate(theta):
        h = np.zeros_like(theta)
        h[i] = width * (abs(value) or 1.0)
        for stencil in (_CENTRAL, _BACKWARD, _FORWARD):
            slopes[i] = sum(weight * float(function(theta + place * h)) for place, weight in stencil.items()) / h[i]
            one_sided[i] = stencil is not _CENTRAL
            if np.isfinite(slopes[i]):
                break
    return slopes, one_sided


WIDTHS = (4e-3, 1e-3, 2.5e-4, 6e-5)
"""Relative widths: the first are limited by curvature, the last by noise."""


class FiniteDifferences(NamedTuple):
    """Slopes of a function by finite differences."""

    slopes: Float[np.ndarray, "parameter"]
    """nan where no width gave a number."""
    uncertainty: Float[np.ndarray, "parameter"]
    """Distance to the slope at the neighbouring width."""


def best_finite_differences(function: Callable, vector, scale: Float[np.ndarray, "parameter"]) -> FiniteDifferences:
    """df/dp by `finite_differences`, entry i moved in units of scale[i]; where `function` is nan it is not used."""
    scaled = np.asarray(vector) / scale
    found = np.stack([finite_differences(lambda u: function(u * scale), scaled, width)[0] / scale for width in WIDTHS])
    change = np.abs(np.diff(found, axis=0))
    known = np.isfinite(change)
    best = np.argmin(np.where(known, change, np.inf), axis=0)
    entries = np.arange(scaled.shape[0])
    decided = np.any(known, axis=0)
    return FiniteDifferences(
        np.where(decided, found[best + 1, entries], np.nan), np.where(decided, change[best, entries], np.nan)
    )


def slopes_nearby(function: Callable, vector, scale: Float[np.ndarray, "parameter"]) -> Float[np.ndarray, "parameter"]:
    """min |f(p +- h e_i) - f(p)| / h over the widest difference: slopes that f has nearby, also where it has none at p.

    The lesser of both sides, so that a jump on one of them counts for nothing; 0 where `function` is nan on both.
    """
    vector = np.asarray(vector)
    middle = function(vector)
    change = lambda step: abs(function(vector + step) - middle)
    changes = [np.fmin(change(step), change(-step)) for step in WIDTHS[0] * np.diag(scale)]
    return np.nan_to_num(np.array(changes)) / (WIDTHS[0] * scale)


def rounding_of_slopes(value: float, scale: Float[np.ndarray, "parameter"], dtype) -> Float[np.ndarray, "parameter"]:
    """What the rounding of f, half a unit at each of its points, may add to a difference of the smallest width."""
    weights = sum(abs(weight) for weight in _FORWARD.values())
    return 0.5 * weights * float(np.finfo(dtype).eps) * abs(value) / (WIDTHS[-1] * scale)
