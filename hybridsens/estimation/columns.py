"""Columns of a table as a record takes them: cells as numbers, which column holds the times, and times in seconds and
in their order; with what to do where they are not."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

TIMES = ("t", "time", "t [s]", "time [s]")
"""Names of times in the unit that a fit takes them in; in another unit they are converted by hand."""
IN_BRACKETS = re.compile(r"[\[(]\s*(.*?)\s*[\])]$")
_SECONDS = ("s", "sec", "second", "seconds", "")
"""What xarray's attribute `units` may say of them, or what stands in brackets behind their name."""
SEVERAL = '"Several records at once" in docs/howto/fit.md'
"""Where a user finds what to do with more than one run."""
_OF_RUNS = f" If the table holds several runs, that would mix them: give each its own column, see {SEVERAL}"


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


def without_unit(name: Any) -> str:
    """`Weg` of `Weg [mm]`."""
    return IN_BRACKETS.sub("", str(name)).strip()


def time_column(table: Mapping[str, Any], index_alone: bool) -> str:
    """The name of the column of times.

    Raises: ValueError if none has the name of one, with the name of that which may be it; at once if that is in
    another unit."""
    known = next((name for name in TIMES if name in table), None)
    if known is None:
        near = next((str(name) for name in table if _is_near(str(name))), None)
        if near is not None and (unit := IN_BRACKETS.search(near)):
            check_unit_of_times(near, unit[1])
        name = near or "name"
        if len(table) > 0 and all(_is_number(name) for name in table):
            raise ValueError(
                f"The first line of the table must name its columns, but has numbers alone: {list(table)}. Put a line "
                'such as "t,q0" before them.'
            )
        own = ' If it is the index, name that: `data.rename_axis("t")`.' if index_alone else ""
        raise ValueError(
            f'The table must have a column of times "t" or "time" [s], but has {list(table)}. Say which one it is: '
            f"`read_measurements(data, time={name!r})`, in a terminal --time {name!r}, or rename it.{own}"
        )
    return known


def _is_number(name: Any) -> bool:
    try:
        float(name)
    except (TypeError, ValueError):
        return False
    return isinstance(name, str)


def check_unit_of_times(name: Any, unit: str | None) -> None:
    """Raises: ValueError for times in another unit than seconds: a fit would take them as they are."""
    if unit is not None and unit not in _SECONDS:
        raise ValueError(
            f"The times {str(name)!r} must be in seconds, or in what the model itself counts in, but are in {unit!r}: "
            'convert them to seconds and say so, "t [s]", or, if the model counts in that unit, leave it out: "t".'
        )


def _is_near(name: str) -> bool:
    """Whether a column may be the times, by its name, whatever the unit."""
    return name.lower().startswith("time") or without_unit(name) == "t"


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
