"""Times of a record and of its events: in seconds, finite, in their order, and what to do where they are not."""

from typing import Any

import numpy as np

from .cells import as_numbers, rows_told

SEVERAL = '"Several records at once" in docs/howto/fit.md'
"""Where a user finds what to do with more than one run."""
_OF_RUNS = f" If the table holds several runs, that would mix them: give each its own column, see {SEVERAL}"


def increasing_samples(times: Any) -> np.ndarray:
    """Times of samples as an array. Raises: ValueError where they do not increase."""
    t = _seconds("times", times)
    _must_increase(
        "times", t, np.flatnonzero(~np.isfinite(t)), "leave them out",
        f"in pandas `table.sort_values(<time>)`.{_OF_RUNS}", f"in pandas `table.groupby(<time>).mean()`.{_OF_RUNS}",
    )  # fmt: skip
    return t


def increasing_events(times: Any, gaps: bool) -> np.ndarray:
    """Times of events as an array, NaN among them only with `gaps`. Raises: ValueError where those that are known do
    not increase."""
    t, kept = _seconds("event_times", times), "with their `event_sigma` and `event_contacts`"
    _must_increase(
        "event_times", t, np.flatnonzero(np.isinf(t) if gaps else ~np.isfinite(t)),
        'for an event that happened and was not seen give NaN, and `missing="skip"`. To leave it out would shift those '
        "after it, for the k-th time is compared with the motion's k-th event",
        f"sort them, {kept}", f"leave out what is there twice, {kept}",
    )  # fmt: skip
    return t


def _must_increase(name: str, t: np.ndarray, unknown: np.ndarray, finite: str, sort: str, once: str) -> None:
    """Raise ValueError for rows that are unknown, fall back or repeat a time, each with its remedy."""
    known = np.flatnonzero(~np.isnan(t))
    later, rise = known[1:], np.diff(t[known])
    for rows, problem, remedy in (
        (unknown, "finite, but is not", finite),
        (later[rise < 0], "sorted in increasing order, but falls back", sort),
        (later[rise == 0], "free of duplicates, but repeats a time", once),
    ):
        if rows.size:
            raise ValueError(f"`{name}` must be {problem} at {rows_told(rows)}: {remedy}.")


def _seconds(name: str, times: Any) -> np.ndarray:
    """Times as numbers: NumPy would make nanoseconds of durations, and of dates."""
    t = np.asanyarray(times)
    if t.dtype.kind == "M":
        raise ValueError(
            f"`{name}` must be in seconds, or durations, but are dates: subtract that of t = 0, as in times - times[0]."
        )
    t = as_numbers(t / np.timedelta64(1, "s") if t.dtype.kind == "m" else t)
    if t.ndim != 1:
        raise ValueError(f"`{name}` must have shape (sample,), but has shape {t.shape}.")
    return t
