"""Value and gradient of a function of a vector, in reverse mode, forward mode or by differences."""

from collections.abc import Callable
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

Mode = Literal["reverse", "forward", "differences"]

QUICKLY = {"xla_backend_optimization_level": 0}
"""How to compile a program that runs a few times only: without optimization, which takes longer than such runs."""


def value_and_gradient(
    function: Callable, mode: Mode, succeeded: Callable[[Any], bool] = lambda aux: True, options: Any = None
) -> Callable[[Any], tuple[Any, Any, Any]]:
    """vector -> (value, gradient, auxiliary output), compiled; `function` returns (value, auxiliary output). `options`
    are those of the compiler."""
    if mode == "reverse":
        way = lambda vector: _reorder(*jax.value_and_grad(function, has_aux=True)(vector))
        return jax.jit(way, compiler_options=options)
    if mode == "forward":
        return jax.jit(lambda vector: _forward(function, vector), compiler_options=options)
    return central_differences(jax.jit(function), succeeded)


def central_differences(function: Callable, succeeded: Callable[[Any], bool]) -> Callable[[Any], tuple[Any, Any, Any]]:
    """dJ/dp_i ~ (J(p + h e_i) - J(p - h e_i)) / 2h with h = eps^(1/3) max(|p_i|, 1): two motions for each parameter.

    Where only one side has a motion (a restitution of 1 can only fall) the difference is one-sided; nan where neither
    has. `succeeded` tells from the auxiliary output of `function` whether the motion is one.
    """

    def side(vector, value, i, h):
        """(J(p + h e_i) - J(p), h), or (0, 0) where there is no motion."""
        offset = np.zeros(vector.shape, vector.dtype)
        offset[i] = h
        J, aux = function(vector + offset)
        return (float(J) - float(value), h) if succeeded(aux) else (0.0, 0.0)

    def evaluate(vector):
        value, aux = function(vector)
        width = float(jnp.finfo(vector.dtype).eps) ** (1 / 3) * np.maximum(np.abs(vector), 1)
        gradient = np.full(vector.shape, np.nan)
        for i, h in enumerate(width):
            (right, h_right), (left, h_left) = side(vector, value, i, h), side(vector, value, i, -h)
            if h_right != h_left:
                gradient[i] = (right - left) / (h_right - h_left)
        return value, gradient, aux

    return evaluate


def _reorder(value_and_aux, gradient):
    value, aux = value_and_aux
    return value, gradient, aux


def _forward(function, vector):
    def with_value(vector):
        value, aux = function(vector)
        return value, (value, aux)

    gradient, (value, aux) = jax.jacfwd(with_value, has_aux=True)(vector)
    return value, gradient, aux
