"""What a user gives, taken for what it must be: real numbers, pairs, mappings."""

import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ..validation.asked import kind_of


def by_name(name: str, given: Any) -> dict[str, Any]:
    """A mapping by names of parameters; empty for None. Raises: TypeError for what is none."""
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(f"`{name}` must be a mapping by names of parameters, but is {shown(given)}.")
    return dict(given or {})


def pair(given: Any) -> tuple[Any, Any] | None:
    """The two entries of a tuple, list or array; None for anything else."""
    two = isinstance(given, tuple | list | np.ndarray | jax.Array) and len(given) == 2
    return (given[0], given[1]) if two else None


def as_real(given: Any) -> float:
    """A real number; NaN for what is none."""
    try:
        return math.nan if isinstance(given, str) else float(given)
    except (TypeError, ValueError):
        return math.nan


def shown(given: Any) -> str:
    """What was given: a text or a number itself, else what it is."""
    return repr(given) if isinstance(given, str | int | float) else kind_of(given)
