"""What speaks against the intervals of a fit."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import stats

from ..system import AbstractHybridSystem
from .columns import rows_told
from .descend import UNFINISHED

_BARELY = 0.9
"""Residuals larger than this part of the data's spread leave less than a fifth of its variance to the model."""
_FAR = 7
"""A residual that is so many times as large as the spread of the others is no noise of one size with them."""
_FEW = 0.1
"""The largest part of a column that counts as outliers."""
_EXACT = 1e-6
"""Residuals smaller than this part of the data are rounding, and alike from sample to sample."""


def doubts(result: Any) -> Iterator[str]:
    """What speaks against the intervals: that there is no minimum, events that are missing, residuals that are no noise
    of the sigmas given."""
    if result.stopped in UNFINISHED:
        yield (
            "it did not converge, and standard errors and intervals are those of a minimum: where it stopped they may "
            "be far too narrow"
        )
    if result.uncertainty.exact:
        yield (
            "residuals are zero to rounding and no sigmas were given, so nothing tells how uncertain the data are, and "
            "there are no intervals: give `sigma`"
        )
    yield from _unexplained(result)
    yield from _outliers(result)
    misfits = [*_alike(result), *_too_large(result)]
    unit = "" if isinstance(result.scene, AbstractHybridSystem) else " s"
    for number in result.events_missing:
        yield (
            f"measured event {number} (at {result.data.event_times[number]:.6g}{unit}) is not in the fitted motion: it "
            "counts as if at the end of the horizon, and no derivative shows the way to it. Give a later `t1`, where "
            "it comes after the horizon, or a guess from which it comes"
        )
    yield from misfits
    if misfits and not result.on_bound:  # a bound in the way is the likelier reason
        yield (
            "the model may be right, and this not the lowest minimum of the loss, for which alone the intervals hold: "
            "`starts=8` looks for another, and so does `strategy=GrowingHorizon()`"
        )


def _alike(result: Any) -> Iterator[str]:
    """Columns whose neighbouring residuals are no independent noise."""
    for i, (name, correlation) in enumerate(result.residual_correlation.items()):
        known = np.isfinite(result.residuals[:, i])
        r, seen = result.residuals[known, i], result.data.values[known, i]
        if correlation > max(0.3, 4 / np.sqrt(max(r.size, 1))) and np.std(r) > _EXACT * np.std(seen):
            yield (
                f"residuals of {name} are alike from sample to sample (correlation {correlation:.2f}): the model "
                f"leaves something out, and the intervals are up to {_too_narrow(correlation):.1f} times too narrow"
            )


def _too_large(result: Any) -> Iterator[str]:
    if _larger_than_sigmas(result):
        noise = result.uncertainty.noise
        yield (
            f"residuals are {noise:.2g} times as large as their sigmas say: the model leaves something out, or the "
            "sigmas are too small; the intervals take them at their word"
        )


def _unexplained(result: Any) -> Iterator[str]:
    """Columns of which a constant would tell as much as the model; where sigmas allow for that, nothing moved."""
    if result.data.sigmas_known and not _larger_than_sigmas(result):
        return
    for name, residuals, values in zip(result.data.names, result.residuals.T, result.data.values.T, strict=True):
        known = np.isfinite(residuals)
        if known.sum() < 3:
            continue
        size, spread = np.sqrt(np.mean(residuals[known] ** 2)), np.std(values[known])
        if size > _BARELY * spread > 0:
            yield (
                f"residuals of {name} are as large ({size:.3g}) as the data's spread ({spread:.3g}): the model tells "
                "hardly more than a constant. Look at the units, at the columns and at the guess; or follow the record "
                "from its beginning in small steps, `strategy=GrowingHorizon(first=0.1, trust=0.25, steps=3)`"
            )


def _outliers(result: Any) -> Iterator[str]:
    """A few residuals that are far larger than the others, and were counted as if they were not."""
    if result.data.sigmas_known and np.isfinite(result.uncertainty.quantile_freedom):
        return  # a robust fit
    data = result.data
    sigmas = np.ones_like(data.values) if data.sigmas is None else data.sigmas
    columns = zip(data.names, (result.residuals / sigmas).T, (data.values / sigmas).T, strict=True)
    for name, residuals, values in columns:
        known = np.isfinite(residuals)
        if not known.any():
            continue
        # About their median, since outliers draw the fit away from the others.
        spread = stats.median_abs_deviation(residuals[known], scale=float(stats.norm.ppf(0.75)))
        far = np.flatnonzero(known & (np.abs(residuals - np.median(residuals[known])) > _FAR * spread))
        if spread > _EXACT * np.std(values[known]) and 0 < far.size <= _FEW * known.sum():
            other, harm = "give `sigma` and", "widen all intervals"
            if data.sigmas_known:  # which the intervals take at their word
                other, harm = "give", "draw the estimates to them"
            yield (
                f"residuals of {name} are more than {_FAR} times as large as most others at {rows_told(far)}. If these "
                f"are outliers, leave them out (nan, with `missing=\"skip\"`), or {other} `robust=3`; they {harm}"
            )


def _larger_than_sigmas(result: Any) -> bool:
    """Whether sigmas were given, and the residuals are larger than they allow."""
    freedom, noise = result.uncertainty.freedom, result.uncertainty.noise
    return bool(result.data.sigmas_known and noise > 1.1 and stats.chi2.sf(freedom * noise**2, freedom) < 1e-6)


def _too_narrow(correlation: float) -> float:
    """Of the mean of noise whose correlations fall off geometrically."""
    return float(np.sqrt((1 + correlation) / max(1 - correlation, 1e-2)))
