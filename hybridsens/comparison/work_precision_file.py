"""The points of a work-precision study in a CSV file."""

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .compare_table import Reference
from .work_precision_points import Point

REFERENCE, GRADIENT, SETTINGS = OF_STUDY = ("reference_value", "reference_slope", "settings")
"""Columns that tell whose points these are: with the J that the errors were measured against, the slope of J in one
direction, and the settings that all points share."""


def check_place(path: Path) -> None:
    """Raises: ValueError for another ending than .csv, or a folder that is not there."""
    if path.suffix != ".csv":
        raise ValueError(f"`store` must end in .csv, but is {path}.")
    if not path.parent.is_dir():
        raise ValueError(f"`store` must lie in a folder that is there, but {path.parent} is not: make it first.")


def write_points(path: Path, points: Sequence[Point], reference: Reference, settings: Mapping[str, Any]) -> None:
    """Write all points in one move, so that a run that is killed leaves the whole file of one point before."""
    study = {REFERENCE: reference.value, GRADIENT: _along(reference.gradient)[0], SETTINGS: _text(settings)}
    rows = [point._asdict() | study for point in points]
    beside = path.with_name(path.name + ".part")
    _write_csv(beside, rows)
    os.replace(beside, path)


def read_points(path: Path, reference: Reference, settings: Mapping[str, Any]) -> tuple[Point, ...]:
    """Points of a study that was begun before; none if there is no file.

    Raises: ValueError if they are no such points, were measured against another J or another gradient (another scene or
    another cost), or under other settings.
    """
    if not path.exists():
        return ()
    rows, columns = list(_read_csv(path)), (*Point._fields, *OF_STUDY)
    if any(set(row) != set(columns) for row in rows):
        raise ValueError(f"{path} must have the columns {', '.join(columns)}, but has others.")
    others = sorted({row.pop(SETTINGS) for row in rows} - {_text(settings)})
    if others:
        raise ValueError(
            f"{path} must have points under the settings {_text(settings)}, but has some under {'; '.join(others)}. "
            "Give the study another `store`."
        )
    known = {float(row.pop(REFERENCE)) for row in rows}
    if not np.allclose(list(known), reference.value, rtol=1e-9, atol=0):
        raise ValueError(
            f"{path} must have points of the same J = {reference.value:.12g}, but has those of J = {known}."
        )
    slopes, (slope, size) = [float(row.pop(GRADIENT)) for row in rows], _along(reference.gradient)
    if not np.allclose(slopes, slope, rtol=0, atol=1e-6 * size):
        raise ValueError(
            f"{path} must have points of the same gradient, but has those of another scene or another cost of that J. "
            "Give the study another `store`."
        )
    return tuple(Point(**{name: Point.__annotations__[name](value) for name, value in row.items()}) for row in rows)


def _text(settings: Mapping[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in sorted(settings.items()))


def _along(gradient: Any) -> tuple[float, float]:
    """Its product with one arbitrary direction, by which it is known however many entries it has; and its size."""
    entries = np.ravel(gradient)
    return float(entries @ np.random.default_rng(0).normal(size=entries.size)), float(np.linalg.norm(entries))


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with open(path, "w", newline="") as file:
        table = csv.DictWriter(file, [*Point._fields, *OF_STUDY])
        table.writeheader()
        table.writerows(rows)


def _read_csv(path: Path) -> Iterable[dict[str, Any]]:
    with open(path, newline="") as file:
        yield from csv.DictReader(file)
