"""Guards and gaps whose dips inside a step cannot be bounded are told."""

import warnings

import numpy as np

from ..interval.kind import Kind
from .stretches import COARSEST, Gap, gap_kinds


def warn_of_sampled(title: str, function: Gap, t, x) -> None:
    """Say so where dips of an entry of a function of (t, x) inside a step are only sampled: a short one may be stepped
    over. `title` is what the entries are called, as in "Gaps"."""
    unknown = np.flatnonzero(gap_kinds(function, t, x)[0] == Kind.UNKNOWN).tolist()
    if unknown:
        warnings.warn(
            f"{title} {unknown} are read from a table or made by a loop or by an operation without known bounds, so a "
            f"dip inside a step is looked for at {round(1 / COARSEST)} places of it or more, and a shorter one is "
            "missed. Give `max_step`, the time that the shortest dip lasts (t1 - t0 if there is none).",
            stacklevel=2,
        )
