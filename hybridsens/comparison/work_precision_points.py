"""What a work-precision study finds: its points, in a CSV file too, the best of them, and what to choose."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..export.datasets import optional
from ..export.one_move import in_one_move
from ..export.text import preformatted, wrapped
from ..settings import finest_tolerance
from ..validation.caller import warn_caller
from .compare_table import Reference

TARGETS = (1e-4, 1e-6, 1e-8)
"""Gradient errors that a printed study gives advice for."""
ALIKE = 1.1
"""Seconds whose ratio is less are the same: a clock is off by so much beside other work."""


class Point(NamedTuple):
    """One setting, what it reached, and what it cost."""

    solver: str
    method: str
    dtype: str
    tolerance: float
    """rtol = atol."""
    value_error: float = np.nan
    """|J - J_ref| / |J_ref|."""
    gradient_error: float = np.nan
    """max_i |g_i - g_ref,i| / max_i |g_ref,i|."""
    seconds: float = np.nan
    """One value with its gradient."""
    first_seconds: float = np.nan
    """The first call: with tracing and compiling at the first tolerance of each solver and method."""
    failure: str = ""

    @property
    def label(self) -> str:
        """The setting in words."""
        single = ", float32" if self.dtype == "float32" else ""
        return f"{self.solver}, rtol {self.tolerance:.0e}, {self.method}{single}"

    @property
    def is_reference(self) -> bool:
        """Whether it is the very run that errors are measured against, or one that agrees with that to the last digit,
        as of a motion that every solver follows exactly: its error is not known."""
        return self.value_error == 0 and self.gradient_error == 0


class WorkPrecision(NamedTuple):
    """Points of a study. Print it, ask it to `recommend`, or draw it (`hybridsens.plot_work_precision`)."""

    points: tuple[Point, ...]
    """One for each method, solver and tolerance."""
    interrupted: bool = False
    """Whether Ctrl-C ended the run: the points are those that were finished."""
    beyond: tuple[str, ...] = ()
    """Dtypes that cannot meet all of the tolerances: they have no points of the tightest."""
    reference: Reference | None = None
    """What errors are measured against; None: not known."""

    def pareto(self, error: str = "gradient_error") -> list[Point]:
        """Points that no other point beats in both time and error, the fastest first. The reference's own run, whose
        error is not known, is none."""
        front: list[Point] = []
        measured = lambda point: not (point.failure or point.is_reference or np.isnan(getattr(point, error)))
        known = list(filter(measured, self.points))
        for point in sorted(known, key=lambda point: (point.seconds, getattr(point, error))):
            if not front or getattr(point, error) < getattr(front[-1], error):
                front.append(point)
        return front

    def recommend(self, gradient_error: float = 1e-6) -> Point | None:
        """The fastest point whose gradient error is at most this; None where no point reaches it, or where the
        reference itself is not known so well. Of points that take as long as it, within what clocks tell apart, the one
        with the least error."""
        if self._blind(gradient_error):
            return None
        good = [point for point in self.points if not point.failure and point.gradient_error <= gradient_error]
        fastest = min((point.seconds for point in good), default=0.0)
        as_fast = [point for point in good if point.seconds <= ALIKE * fastest]
        return min(as_fast, key=lambda point: point.gradient_error, default=None)

    def to_pandas(self):
        """A pandas DataFrame with a row for each point. Raises: ImportError without pandas."""
        return optional("pandas", "to_pandas()").DataFrame(self.points, columns=list(Point._fields))

    _repr_html_ = preformatted  # what a notebook shows

    def __str__(self) -> str:
        front = set(self.pareto())
        width = max([len(point.label) for point in self.points], default=0) + 2
        lines = [f"{'':2}{'setting':{width}}{'value err':>11}{'gradient err':>13}{'time':>12}"]
        for point in self.points:
            errors = f"{point.value_error:>11.1e}{point.gradient_error:>13.1e}"
            errors = f"{'(as the reference)':>24}" if point.is_reference else errors
            numbers = f"{errors}{1e3 * point.seconds:>9.3f} ms"
            mark = "* " if point in front else "  "
            lines.append(f"{mark}{point.label:{width}}" + (f"  failed: {point.failure}" if point.failure else numbers))
        lines += [f"  (no {t} below {finest_tolerance(t):.1e}: it cannot meet such tolerances)" for t in self.beyond]
        lines += ["  (interrupted: the remaining points were not run)"] if self.interrupted else []
        remark = "" if self.reference is None else self.reference.remark
        lines += [wrapped(f"  (reference {remark})", 2)] if remark else []
        lines.append("* no other point is both faster and more accurate")
        return "\n".join([*lines, *map(self.advice, TARGETS)])

    def advice(self, gradient_error: float) -> str:
        """The recommendation in a sentence."""
        if self._blind(gradient_error):
            return f"for gradient error {gradient_error:.0e} on this scene: the reference is not known so well"
        best = self.recommend(gradient_error)
        if best is None:
            return f"for gradient error {gradient_error:.0e} on this scene: no point reaches it"
        return f"for gradient error {gradient_error:.0e} on this scene: {best.label}: {1e3 * best.seconds:.3g} ms"

    def _blind(self, gradient_error: float) -> bool:
        """Whether no such error can be told."""
        return self.reference is not None and not self.reference.gradient_error <= gradient_error


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
    try:
        with in_one_move(path) as draft:
            _write_csv(draft, rows)
    except OSError as error:  # the study itself is worth more
        warn_caller(f"{path} cannot be written ({error.strerror}). The study goes on.")


def read_points(path: Path, reference: Reference, settings: Mapping[str, Any]) -> tuple[Point, ...]:
    """Points of a study that was begun before; none if there is no file.

    Raises: ValueError if they are no such points, were measured against another J or another gradient (another scene or
    another cost), or under other settings.
    """
    if not path.exists():
        return ()
    rows = _read_csv(path)
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


COLUMNS = (*Point._fields, *OF_STUDY)


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(rows)


def _read_csv(path: Path) -> list[dict[str, Any]]:
    """Raises: ValueError for a file of other columns, and for one that is cut or is no text."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} must be a CSV file in UTF-8, but is not: {error}.") from error
    rows = list(csv.DictReader(text.splitlines()))
    if any(set(row) - {None} != set(COLUMNS) for row in rows):
        raise ValueError(f"{path} must have the columns {', '.join(COLUMNS)}, but has others.")
    if not text.endswith("\n") or any(None in row or None in row.values() for row in rows):
        raise ValueError(f"{path} must have whole lines, but is cut: remove the last line, or give another `store`.")
    return rows
