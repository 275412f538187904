"""Differences of fourth order: the independent check of a gradient, as good as the function is smooth."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

_CENTRAL = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}
_BACKWARD = {0: 25 / 12, -1: -48 / 12, -2: 36 / 12, -3: -16 / 12, -4: 3 / 12}
_FORWARD = {-place: -weight for place, weight in _BACKWARD.items()}


def differences(
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
