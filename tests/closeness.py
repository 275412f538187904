"""What close means, for the whole suite."""

import numpy as np


def assert_close(found, expected, within: float, scale: float | None = None) -> None:
    """Assert that arrays have one shape and differ by at most `within`, relative to the largest expected entry.

    `scale` replaces that entry where the expected values are zero or too small to be a yardstick.
    """
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, f"must have shape {expected.shape}, but has shape {found.shape}"
    error = worst(found, expected, scale)
    assert error <= within, f"differs by {error:.2e} where {within:.0e} was allowed:\n{found}\nexpected\n{expected}"


def worst(found, expected, scale: float | None = None) -> float:
    """Largest difference relative to the largest expected entry (or to `scale`)."""
    found, expected = np.asarray(found), np.asarray(expected)
    size = np.max(np.abs(expected)) if scale is None else scale
    return float(np.max(np.abs(found - expected), initial=0.0) / size)
