"""Cells of a table: as numbers, and rows of them in words."""

from typing import Any

import numpy as np


def as_numbers(given: Any) -> np.ndarray:
    """An array of floats, with NaN for what a masked array hides. Raises: ValueError for complex numbers."""
    if np.iscomplexobj(given):
        raise ValueError(
            "What was measured must be real numbers, but there are complex ones: give their real and their imaginary "
            "parts as columns."
        )
    return np.ma.asarray(given, float).filled(np.nan) if np.ma.isMaskedArray(given) else np.asarray(given, float)


def rows_told(rows: np.ndarray) -> str:
    """The first of these rows, in words."""
    shown = ", ".join(str(int(row)) for row in rows[:5])
    return f"row{'s' if rows.size > 1 else ''} {shown}{', ...' if rows.size > 5 else ''} (counted from 0)"
