"""Which column of a table holds the times, and in which unit they are."""

import re
from collections.abc import Mapping
from typing import Any

TIMES = ("t", "time", "t [s]", "time [s]")
"""Names of times in the unit that a fit takes them in; in another unit they are converted by hand."""
IN_BRACKETS = re.compile(r"[\[(]\s*(.*?)\s*[\])]$")
_SECONDS = ("s", "sec", "second", "seconds", "")
"""What xarray's attribute `units` may say of them, or what stands in brackets behind their name."""


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
