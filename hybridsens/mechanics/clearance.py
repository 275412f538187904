"""Gaps whose dips inside a step cannot be bounded are told."""

import warnings

import numpy as np

from ..interval.kind import Kind
from ..search.stretches import COARSEST, gap_kinds
from .scene import AbstractScene


def warn_of_sampled_gaps(scene: AbstractScene, t, q) -> None:
    """Say so where dips of a gap inside a step are only sampled: a short one may be stepped over."""
    unknown = np.flatnonzero(gap_kinds(scene.gap, t, q)[0] == Kind.UNKNOWN).tolist()
    if unknown:
        warnings.warn(
            f"Gaps {unknown} are read from a table or made by a loop or by an operation without known bounds, so a dip "
            f"inside a step is looked for at {round(1 / COARSEST)} places of it or more, and a shorter one is missed. "
            "Give `max_step`, the time that the shortest dip lasts (t1 - t0 if there is none).",
            stacklevel=2,
        )
