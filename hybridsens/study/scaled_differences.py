"""Differences at several widths, of which each entry takes those that agree best."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .differences import differences

WIDTHS = (4e-3, 1e-3, 2.5e-4, 6e-5)
"""Relative widths: the first are limited by curvature, the last by noise."""


class Differences(NamedTuple):
    """Slopes of a function by differences."""

    slopes: Float[np.ndarray, "parameter"]
    """nan where no width gave a number."""
    uncertainty: Float[np.ndarray, "parameter"]
    """Distance to the slope at the neighbouring width."""


def scaled_differences(function: Callable, vector, scale: Float[np.ndarray, "parameter"]) -> Differences:
    """df/dp by `differences`, entry i moved in units of scale[i]; where `function` is nan it is not used."""
    scaled = np.asarray(vector) / scale
    found = np.stack([differences(lambda u: function(u * scale), scaled, width)[0] / scale for width in WIDTHS])
    change = np.abs(np.diff(found, axis=0))
    known = np.isfinite(change)
    best = np.argmin(np.where(known, change, np.inf), axis=0)
    entries = np.arange(scaled.shape[0])
    decided = np.any(known, axis=0)
    return Differences(
        np.where(decided, found[best + 1, entries], np.nan), np.where(decided, change[best, entries], np.nan)
    )
