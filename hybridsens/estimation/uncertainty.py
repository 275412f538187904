"""What a fit knows: covariance, intervals, correlations, the directions that the data do not determine, and how well it
knows what is made of a fitted scene, as another experiment."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import stats

from ..validation.caller import warn_caller

_NULL = 1e-7
_ROUNDING = 100
"""Doubling a parameter must move the data by so many units of their last place, else it does not move them."""
_MOST = 1e6
"""The largest error, relative to the value, that is told from larger ones."""
_NEAR = 0.1
"""A value below this part of its parameter's size is near 0. Above it, shares are of a change relative to the value."""


class Uncertainty(NamedTuple):
    """First-order uncertainty of the fitted parameters p around the minimum."""

    covariance: Float[np.ndarray, "parameter parameter"]
    """(J^T J / s^2 + priors)^-1; inf on the diagonal of a parameter that is unseen or takes part in a null direction,
    nan elsewhere if the residuals are `exact`. nan for a parameter on its bound; the others are known as if it were
    held there."""
    standard_errors: Float[np.ndarray, "parameter"]
    correlation: Float[np.ndarray, "parameter parameter"]
    """nan where a standard error is not finite."""
    noise: float
    """s: standard deviation of the residuals, in sigmas; in the data's unit where no sigmas were given."""
    freedom: int
    """Residuals less the directions of the parameters that move them; one on its bound has none."""
    quantile_freedom: float
    """Degrees of freedom of Student's t for intervals; inf (a normal distribution) where sigmas were given, unless the
    fit is robust, whose residuals tell s anew."""
    null_directions: list[dict[str, float]]
    """Directions of several parameters along which the data say nothing, label -> relative share."""
    unseen: tuple[str, ...]
    """Parameters of which the data say nothing, because nothing that was measured depends on them."""
    exact: bool
    """No sigmas were given, and the residuals are zero to rounding: they do not tell how uncertain the data are."""


class Noise(NamedTuple):
    """What is known of the noise of the data."""

    sigmas_given: bool
    robust: float = np.inf
    """Residuals beyond so many sigmas counted linearly; inf: none did."""
    largest: float = 0.0
    """The largest datum in sigmas."""
    rounding: float = 0.0
    """A standard deviation of residuals that is no noise where no sigmas were given."""
    scale: Float[np.ndarray, "parameter"] | float = 0.0
    """Sizes of parameters whose value is near 0 beside them, and tells none."""


def uncertainty(labels: Sequence[str], values, residuals, jacobian, prior_weight, noise: Noise) -> Uncertainty:
    """Uncertainty from plain data residuals r (in sigmas) and their Jacobian J = dr/dp.

    With known sigmas s = 1, otherwise s^2 = sum psi(r)^2 / (n - rank J) / mean(psi')^2, where psi(r) = r, or
    r / sqrt(1 + (r/c)^2) for a robust fit with finite c (Huber's covariance of an M-estimator, also used with known
    sigmas then).
    """
    r, J, p = np.asarray(residuals), np.asarray(jacobian), np.asarray(values)
    size = np.where(np.abs(p) < _NEAR * noise.scale, noise.scale, np.abs(p))
    size = np.where(size == 0, 1.0, size)
    unseen = np.max(np.abs(J * size), axis=0, initial=0) <= _ROUNDING * np.finfo(J.dtype).eps * noise.largest
    J = np.where(unseen, 0, J)
    freedom = max(r.size - _rank(J), 1)
    seen = _noise(r, freedom, noise.robust)
    exact = not noise.sigmas_given and seen <= noise.rounding
    taken_at_their_word = noise.sigmas_given and np.isinf(noise.robust)
    unit = 1.0 if taken_at_their_word else max(seen, noise.rounding)
    rows = np.vstack([J / (unit if unit > 0 else 1.0), np.diag(prior_weight)])
    covariance, null = _inverse(rows, size)
    correlation = _correlation(covariance)
    if exact:
        covariance = np.where(np.isinf(covariance), covariance, np.nan)
    return Uncertainty(
        covariance, np.sqrt(np.diag(covariance)), correlation, seen, freedom,
        quantile_freedom=np.inf if taken_at_their_word else float(freedom),
        null_directions=[dict(zip(labels, map(float, direction), strict=True)) for direction in null],
        unseen=tuple(label for label, hidden in zip(labels, unseen, strict=True) if hidden), exact=exact,
    )  # fmt: skip


def with_held(known: Uncertainty, held: np.ndarray) -> Uncertainty:
    """What is known of all parameters, from what is known of those that are not `held`: nan for these."""

    def widened(square):
        whole = np.full((held.size, held.size), np.nan)
        whole[np.ix_(~held, ~held)] = square
        return whole

    covariance = widened(known.covariance)
    errors = np.sqrt(np.diag(covariance))
    return known._replace(covariance=covariance, standard_errors=errors, correlation=widened(known.correlation))


def _noise(r: np.ndarray, freedom: int, robust: float) -> float:
    weight = (1 + (r / robust) ** 2) ** -0.5
    return float(np.sqrt(np.sum((r * weight) ** 2) / freedom) / np.mean(weight**3))


def _correlation(covariance: np.ndarray) -> np.ndarray:
    errors = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        return covariance / np.outer(errors, errors)


def _inverse(rows: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(rows^T rows)^-1, with inf for what takes part in a null direction or has no rows, and the null directions,
    relative to the sizes of the parameters."""
    told = np.any(rows != 0, axis=0)
    inverse, null = np.diag(np.where(told, 0, np.inf)), np.zeros((0, told.size))
    if told.any():
        inverse[np.ix_(told, told)], directions = _inverse_told(rows[:, told])
        null = np.zeros((len(directions), told.size))
        null[:, told] = directions / size[told]
        null /= np.linalg.norm(null, axis=1, keepdims=True)
    return inverse, null


def _rank(rows: np.ndarray) -> int:
    """In how many directions parameters move the rows; of two that do the same, one counts."""
    told = rows[:, np.any(rows != 0, axis=0)]
    return 0 if told.size == 0 else int(np.sum(~_directions(told)[-1]))


def _directions(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lengths of the columns, singular values and directions of what they are at length 1, and which of these are null.
    So a parameter which is known much worse than others is not taken for one that is not known at all."""
    length = np.linalg.norm(rows, axis=0)
    _, s, vt = np.linalg.svd(rows / length, full_matrices=False)
    return length, s, vt, s <= _NULL * s[0]


def _inverse_told(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same where all have rows."""
    length, s, vt, null = _directions(rows)
    inverse = (vt[~null].T / s[~null] ** 2) @ vt[~null] / np.outer(length, length)
    touched = np.any(np.abs(vt[null]) > 1e-3, axis=0) if null.any() else np.zeros(rows.shape[1], bool)
    inverse[np.diag_indices_from(inverse)] += np.where(touched, np.inf, 0)
    return inverse, vt[null] / length


def weak_directions(
    labels: Sequence[str], values, covariance, limit: float = 0.5
) -> list[tuple[float, dict[str, float]]]:
    """Directions of relative change with a standard error above `limit`: (error, label -> share), worst first.

    A standard error of 0.5 says that along this direction the parameters may change by half without being noticed.
    """
    size = np.where(np.asarray(values) == 0, 1.0, np.abs(np.asarray(values)))
    # Beside an error of more than a million times the value, those of the others would be rounding.
    errors = np.sqrt(np.diag(covariance))
    size = np.maximum(size, np.where(np.isfinite(errors), errors / _MOST, 0))
    relative = np.asarray(covariance) / np.outer(size, size)
    known = np.isfinite(np.diag(relative))
    variances, directions = np.linalg.eigh(relative[np.ix_(known, known)])
    names = [label for label, keep in zip(labels, known, strict=True) if keep]
    return [
        (float(np.sqrt(variance)), dict(zip(names, (float(x) for x in direction), strict=True)))
        for variance, direction in zip(variances[::-1], directions.T[::-1], strict=True)
        if variance > limit**2
    ]


def half_width(error, level: float, freedom: float):
    """Half the width of a confidence interval of this level.

    Raises: ValueError for a level outside (0, 1).
    """
    if not 0 < level < 1:
        raise ValueError(f"`level` must lie inside (0, 1), but is {level}.")
    quantile = stats.norm.ppf if np.isinf(freedom) else lambda p: stats.t.ppf(p, freedom)
    return error * quantile((1 + level) / 2)


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


def neighbour_correlation(residuals: np.ndarray) -> float:
    """sum r_i r_(i+1) / (sum r_i^2 sum r_(i+1)^2)^(1/2) over neighbours that were both measured; NaN without at least
    two pairs."""
    r = np.asarray(residuals)
    pairs = np.isfinite(r[:-1]) & np.isfinite(r[1:])
    one, next_one = r[:-1][pairs], r[1:][pairs]
    size = np.sqrt(np.sum(one**2)) * np.sqrt(np.sum(next_one**2))
    return float(one @ next_one / size) if pairs.sum() > 1 and size > 0 else float("nan")
