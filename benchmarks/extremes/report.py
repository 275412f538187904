"""How every case reports: rows in one table, printed and written to results/extremes/<case>.csv."""

import argparse
import csv
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import hybridsens as hs

from ..machine import describe

FOLDER = Path("results/extremes")


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of a table."""

    case: str
    what: str
    at: float | int | str
    """Where in its range (speed, ratio, number of events)."""
    error: float | None
    """Largest error against the independent truth; None where the line is a count or a status."""
    ends: str = ""
    """How the motion ended, if not successfully."""


def status_name(trajectory) -> str:
    """Name of a trajectory's status, empty for success."""
    names = ("grazing", "max_events_reached", "max_steps_reached", "event_repeats", "non_finite")
    found = [name for name in names if trajectory.status == getattr(hs.Status, name)]
    return "" if trajectory.status == hs.Status.successful else (found or ["another status"])[0]


def show(rows: list[Row]) -> None:
    """Print rows in columns."""
    for row in rows:
        error = "" if row.error is None else f"{row.error:.1e}"
        at = row.at if isinstance(row.at, str | int) else f"{row.at:g}"
        print(f"{row.case:24} {row.what:44} {at!s:>12} {error:>9}  {row.ends}", flush=True)


def write(name: str, rows: list[Row]) -> None:
    """Write rows, and beside them the machine they were found on."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with open(FOLDER / f"{name}.csv", "w", newline="") as file:
        table = csv.writer(file)
        table.writerow([field.name for field in dataclasses.fields(Row)])
        table.writerows(dataclasses.astuple(row) for row in rows)
    (FOLDER / f"{name}.json").write_text(json.dumps(describe(), indent=1))


def run(name: str, study: Callable[[], list[Row]]) -> list[Row]:
    """Run one study, print and write its rows."""
    hs.configure()
    rows = study()
    show(rows)
    write(name, rows)
    return rows


def main_of(name: str, study: Callable[[argparse.Namespace], list[Row]], parser: argparse.ArgumentParser) -> None:
    """The command line of one case."""
    arguments = parser.parse_args()
    run(name, lambda: study(arguments))
