"""Derivatives of a function of a vector: in reverse mode, in forward mode, or by differences of two motions; and finite
differences of fourth order, the independent check of a gradient, as good as the function is smooth."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

Mode = Literal["reverse", "forward", "differences"]

QUICKLY = {"xla_backend_optimization_level": 0}
"""How to compile a program that runs a few times only: without optimization, which takes longer than such runs."""


def value_and_gradient(
    function: Callable, mode: Mode, succeeded: Callable[[Any], bool] = lambda aux: True, options: Any = None
) -> Callable[[Any], tuple[Any, Any, Any]]:
    """vector -> (value, gradient, auxiliary output), compiled; `function` returns (value, auxiliary output). `options`
    are those of the compiler."""
    if mode == "differences":
        return central_differences(jax.jit(function), succeeded)
    way = _reverse if mode == "reverse" else _forward
    return jax.jit(lambda vector: way(function, vector), compiler_options=options)


def central_differences(function: Callable, succeeded: Callable[[Any], bool]) -> Callable[[Any], tuple[Any, Any, Any]]:
    """dJ/dp_i ~ (J(p + h e_i) - J(p - h e_i)) / 2h with h = eps^(1/3) max(|p_i|, 1): two motions for each parameter.

    Where only one side has a motion (a restitution of 1 can only fall) the difference is one-sided. Where neither has,
    beside a small parameter that may not leave its range, h is eps^(1/3) |p_i|; nan if neither has then. `succeeded`
    tells from the auxiliary output of `function` whether the motion is one.
    """

    def side(vector, value, i, h):
        """(J(p + h e_i) - J(p), h), or (0, 0) where there is no motion."""
        offset = np.zeros(vector.shape, vector.dtype)
        offset[i] = h
        J, aux = function(vector + offset)
        return (float(J) - float(value), h) if succeeded(aux) else (0.0, 0.0)

    def evaluate(vector):
        value, aux = function(vector)
        width, sizes = float(jnp.finfo(vector.dtype).eps) ** (1 / 3), np.abs(vector)
        gradient = np.full(vector.shape, np.nan)
        for i, widths in enumerate(zip(width * np.maximum(sizes, 1), width * sizes, strict=True)):
            for h in widths:
                (right, h_right), (left, h_left) = side(vector, value, i, h), side(vector, value, i, -h)
                if h_right != h_left:
                    gradient[i] = (right - left) / (h_right - h_left)
                    break
        return value, gradient, aux

    return evaluate


def _reverse(function, vector):
    (value, aux), gradient = jax.value_and_grad(function, has_aux=True)(vector)
    return value, gradient, aux


def _forward(function, vector):
    def with_value(vector):
        value, aux = function(vector)
        return value, (value, aux)

    gradient, (value, aux) = jax.jacfwd(with_value, has_aux=True)(vector)
    return value, gradient, aux


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


WIDTHS = (4e-3, 1e-3, 2.5e-4, 6e-5, 1.5e-5)
"""Relative widths: the first are limited by curvature, or by another event nearby; the last by noise."""


class FiniteDifferences(NamedTuple):
    """Slopes of a function by finite differences."""

    slopes: Float[np.ndarray, "parameter"]
    """nan where no width gave a number."""
    uncertainty: Float[np.ndarray, "parameter"]
    """Distance to the slope at the neighbouring width."""
    one_sided: Bool[np.ndarray, "parameter"]
    """Which of them are made of one side."""


def best_finite_differences(function: Callable, vector, scale: Float[np.ndarray, "parameter"]) -> FiniteDifferences:
    """df/dp by `finite_differences`, entry i moved in units of scale[i]; where `function` is nan it is not used."""
    scaled = np.asarray(vector) / scale
    found, one_sided = zip(*(finite_differences(lambda u: function(u * scale), scaled, h) for h in WIDTHS), strict=True)
    found, one_sided = np.stack(found) / scale, np.stack(one_sided)
    change = np.abs(np.diff(found, axis=0))
    known = np.isfinite(change)
    best = np.argmin(np.where(known, change, np.inf), axis=0)
    entries = np.arange(scaled.shape[0])
    decided = np.any(known, axis=0)
    return FiniteDifferences(
        np.where(decided, found[best + 1, entries], np.nan), np.where(decided, change[best, entries], np.nan),
        one_sided[best + 1, entries],
    )  # fmt: skip


def slopes_nearby(function: Callable, vector, scale: Float[np.ndarray, "parameter"]) -> Float[np.ndarray, "parameter"]:
    """min |f(p +- h e_i) - f(p)| / h over the widest difference: slopes that f has nearby, also where it has none at p.

    The lesser of both sides, so that a jump on one of them counts for nothing; 0 where `function` is nan on both.
    """
    vector = np.asarray(vector)
    middle = function(vector)
    change = lambda step: abs(function(vector + step) - middle)
    changes = [np.fmin(change(step), change(-step)) for step in WIDTHS[0] * np.diag(scale)]
    return np.nan_to_num(np.array(changes)) / (WIDTHS[0] * scale)


def rounding_of_slopes(value, scale: Float[np.ndarray, "parameter"], dtype) -> Float[np.ndarray, "parameter"]:
    """What the rounding of f, half a unit at each of its points, may add to a difference of the smallest width."""
    weights = sum(abs(weight) for weight in _FORWARD.values())
    return 0.5 * weights * float(np.finfo(dtype).eps) * np.abs(value) / (WIDTHS[-1] * scale)
