"""The points of a work-precision study in a CSV file."""

import csv
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .work_precision_points import Point

REFERENCE = "reference_value"
"""Column with the J that the errors were measured against: it tells whose points these are."""


def check_ending(path: Path) -> None:
    """Raises: ValueError for another ending than .csv."""
    if path.suffix != ".csv":
        raise ValueError(f"`store` must end in .csv, but is {path}.")


def write_points(path: Path, points: Sequence[Point], reference: float) -> None:
    """Write all points in one move, so that a run that is killed leaves the whole file of one point before."""
    rows = [point._asdict() | {REFERENCE: reference} for point in points]
    beside = path.with_name(path.name + ".part")
    _write_csv(beside, rows)
    os.replace(beside, path)


def read_points(path: Path, reference: float) -> tuple[Point, ...]:
    """Points of a study that was begun before; none if there is no file.

    Raises: ValueError if they are no such points, or were measured against another J: another scene or another cost.
    """
    if not path.exists():
        return ()
    rows = list(_read_csv(path))
    if any(set(row) != {*Point._fields, REFERENCE} for row in rows):
        raise ValueError(f"{path} must have the columns {', '.join(Point._fields)}, {REFERENCE}, but has others.")
    known = {float(row.pop(REFERENCE)) for row in rows}
    if not np.allclose(list(known), reference, rtol=1e-9, atol=0):
        raise ValueError(f"{path} must have points of the same J = {reference:.12g}, but has those of J = {known}.")
    return tuple(Point(**{name: Point.__annotations__[name](value) for name, value in row.items()}) for row in rows)


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with open(path, "w", newline="") as file:
        table = csv.DictWriter(file, [*Point._fields, REFERENCE])
        table.writeheader()
        table.writerows(rows)


def _read_csv(path: Path) -> Iterable[dict[str, Any]]:
    with open(path, newline="") as file:
        yield from csv.DictReader(file)
