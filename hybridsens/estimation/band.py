"""What is made of a fitted scene, as another experiment, and how well the data tell it."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..validation.caller import warn_caller
from .uncertainty import Uncertainty, half_width


class Band(NamedTuple):
    """Numbers and their confidence intervals, all of one shape."""

    value: Float[np.ndarray, "*shape"]
    low: Float[np.ndarray, "*shape"]
    high: Float[np.ndarray, "*shape"]


def band(function: Callable[[Any], Any], values, uncertainty: Uncertainty, level: float) -> Band:
    """g(p) and g(p) -+ t (J C J^T)^(1/2) with J = dg/dp, of a function g of the fitted numbers p.

    Raises: TypeError for a function that returns no array of real numbers."""

    def twice(p):
        found = function(p)
        if not hasattr(found, "dtype") or not jnp.issubdtype(found.dtype, jnp.floating):
            raise TypeError(
                f"`function(scene)` must return an array of real numbers, but returns {type(found).__name__}: "
                "`motion.q[:, 0]`, say."
            )
        return found, found

    J, value = jax.jacfwd(twice, has_aux=True)(jnp.asarray(values))
    if lost := int(np.sum(~np.isfinite(value))):
        warn_caller(
            f"{lost} of {value.size} numbers that `function(scene)` returns are not finite: times of events that did "
            "not come are inf (lengthen the horizon, or raise `max_events`), what a motion did not reach is nan."
        )
    half = half_width(_spread(np.asarray(J), uncertainty), level, uncertainty.quantile_freedom)
    return Band(np.asarray(value), np.asarray(value - half), np.asarray(value + half))


def _spread(J: Float[np.ndarray, "*shape parameter"], uncertainty: Uncertainty) -> Float[np.ndarray, "*shape"]:
    """Standard error. A parameter on its bound is held there; what depends on one that is not known is not either."""
    variance = np.diagonal(uncertainty.covariance)
    if uncertainty.exact:
        return np.full(J.shape[:-1], np.nan)
    known, unknown = np.isfinite(variance), np.isinf(variance)
    of_known, C = J[..., known], uncertainty.covariance[np.ix_(known, known)]
    squared = np.maximum(np.einsum("...i,ij,...j->...", of_known, C, of_known), 0)  # by rounding it may be below
    return np.where((J[..., unknown] != 0).any(-1), np.inf, np.sqrt(squared))
