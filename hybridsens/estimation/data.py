"""Measurements: what was seen, when, and how exactly; with every requirement checked when they are made."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from ..export.names import split_unit
from ..export.text import array_text, preformatted
from .columns import as_numbers, increasing_events, increasing_samples, rows_told


class Measurements(eqx.Module):
    """A record of a motion. Values that are missing are NaN and have no weight in a fit."""

    times: np.ndarray
    """(sample,) strictly increasing [s]."""
    values: np.ndarray
    """(sample, observation) what was measured; NaN where nothing was."""
    sigmas: np.ndarray | None
    """(sample, observation) standard deviations; None: equal and unknown, to be estimated from the fit, where neither
    event times nor priors are weighed against them."""
    names: tuple[str, ...]
    """One for each observation."""
    event_times: np.ndarray
    """(event,) times of impacts, increasing [s]; NaN for one that was not seen; may be empty."""
    event_sigmas: np.ndarray
    """(event,) standard deviations of those times [s]."""
    event_contacts: np.ndarray
    """(event,) which contact closed; -1 where that is not known."""

    @property
    def any_values(self) -> bool:
        """Whether a value was measured, and not event times alone."""
        return bool(np.any(np.isfinite(self.values)))

    @property
    def any_events(self) -> bool:
        """Whether the time of an event was measured."""
        return bool(np.any(np.isfinite(self.event_times)))

    @property
    def sigmas_known(self) -> bool:
        """Whether the sigmas of all that was measured are known; those of event times always are."""
        return self.sigmas is not None or not self.any_values

    @property
    def spread(self) -> float:
        """The largest standard deviation of a column of values; 0 where there is none."""
        columns = [column[np.isfinite(column)] for column in self.values.T]
        return max((float(np.std(column)) for column in columns if column.size), default=0.0)

    def __str__(self) -> str:
        """Columns with how many values each has, between which values and times they lie, and event times."""
        told = []
        if self.times.size:
            known = "with sigmas" if self.sigmas is not None else "without sigmas"
            told.append(f"{self.times.size} times from {np.min(self.times):g} to {np.max(self.times):g}, {known}")
        for name, column in zip(self.names, self.values.T, strict=True):
            seen = column[np.isfinite(column)]
            if seen.size:
                told.append(f"{name}: {seen.size} values from {np.min(seen):g} to {np.max(seen):g}")
        if self.event_times.size:
            heard = self.event_times[np.isfinite(self.event_times)]
            told.append(f"event times: {heard.size} of {self.event_times.size} seen, {array_text(heard, threshold=8)}")
        return "\n".join(told)

    _repr_html_ = preformatted  # what a notebook shows

    def between(self, start: float, end: float) -> "Measurements":
        """The part with start <= t < end, to fit one part of a record and predict another. Events before it stay as not
        seen (NaN), so that the others keep their numbers.

        Raises: ValueError if nothing was measured then.
        """
        rows, kept = (self.times >= start) & (self.times < end), ~(self.event_times >= end)
        events = np.where(self.event_times < start, np.nan, self.event_times)[kept]
        if not rows.any() and np.all(np.isnan(events)):
            raise ValueError(f"There must be a measurement with {start} <= t < {end}, but there is none.")
        sigmas = None if self.sigmas is None else self.sigmas[rows]
        return Measurements(self.times[rows], self.values[rows], sigmas, self.names, events, self.event_sigmas[kept],
                            self.event_contacts[kept])  # fmt: skip


def measurements(
    times: Any = (),
    values: Any = None,
    *,
    sigma: Any = None,
    names: Sequence[str] | str | None = None,
    missing: str = "raise",
    event_times: Any = (),
    event_sigma: Any = None,
    event_contacts: Any = -1,
) -> Measurements:
    """Measurements from arrays.

    Arguments:

    - `times`: (sample,) strictly increasing [s]; durations (`timedelta64`) become seconds, dates are refused.
    - `values`: (sample,) or (sample, observation).
    - `sigma`: standard deviations, anything that broadcasts to the values, or of each name its own, {"q0": 0.1},
      where a unit may be left off; None if they are equal and unknown. A fit of values and event times needs them, and
      one with priors.
    - `names`: names of the observations; default q0, q1, ...
    - `missing`: "raise" on a NaN among the values or event times, or "skip" to leave those entries out of the fit.
      What a masked array of NumPy hides is NaN.
    - `event_times`, `event_sigma`, `event_contacts`: times of impacts [s], their standard deviation (required with
      them), and which contact closed (-1: any). The k-th time is compared with the motion's k-th impact there; NaN
      stands for an impact that happened and was not seen.

    Raises: ValueError, saying what must hold and which rows break it.
    """
    if missing not in ("raise", "skip"):
        raise ValueError(f'`missing` must be "raise" or "skip", but is {missing!r}.')
    t = increasing_samples(times)
    y = _values(values, t.size)
    names = [names] if isinstance(names, str) else names
    labels = tuple(names) if names is not None else tuple(f"q{i}" for i in range(y.shape[1]))
    if len(labels) != y.shape[1] or len(set(labels)) != len(labels):
        raise ValueError(
            f"`names` must have {y.shape[1]} different entries, one for each observation, but has {labels}."
        )
    check_values(y, labels, missing)
    events = increasing_events(event_times, gaps=missing == "skip")
    if t.size + np.sum(~np.isnan(events)) == 0:
        raise ValueError("The measurements must have at least one time, but have none.")
    return Measurements(
        t, y, _sigmas(_by_column(sigma, labels), y), labels, events,
        *_event_columns(events, event_sigma, event_contacts),
    )  # fmt: skip


def _values(values: Any, samples: int) -> np.ndarray:
    if values is None:
        if samples:
            raise ValueError(f"`values` must have one row for each of the {samples} times, but is None.")
        return np.zeros((0, 0))
    try:
        y = as_numbers(values)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"`values` must be an array of real numbers, but is a {type(values).__name__} that is none. A table with "
            "named columns goes to `read_measurements` or straight to `fit`."
        ) from error
    y = y[:, None] if y.ndim == 1 else y
    if y.ndim != 2 or y.shape[0] != samples:
        raise ValueError(f"`values` must have shape ({samples},) or ({samples}, observation), but has shape {y.shape}.")
    return y


def check_values(y: np.ndarray, names: Sequence[str], missing: str) -> None:
    """Raises: ValueError for a column with an infinite value, one that is NaN and may not be, or nothing at all."""
    for name, column in zip(names, y.T, strict=True):
        if np.any(np.isinf(column)):
            raise ValueError(
                f"Column {name!r} must be finite, but is not at {rows_told(np.flatnonzero(np.isinf(column)))}."
            )
        gaps = np.flatnonzero(np.isnan(column))
        if gaps.size and missing == "raise":
            raise ValueError(
                f"Column {name!r} must have a value in every row, but is NaN at {rows_told(gaps)}. Such entries are "
                'left out of the fit by `read_measurements(data, missing="skip")`, in a terminal by --skip-missing.'
            )
        if gaps.size == column.size > 0:
            raise ValueError(f"Column {name!r} must have at least one value, but is NaN everywhere.")


def _by_column(sigma: Any, names: tuple[str, ...]) -> Any:
    """Standard deviations that are given by name, in the order of the columns. A unit may be left off."""
    if not isinstance(sigma, Mapping):
        return sigma
    keys = [name if name in sigma else split_unit(name)[0] for name in names]
    if set(sigma) != set(keys) or len(set(keys)) < len(keys):
        raise ValueError(
            f"`sigma` must have one entry for each observation, {', '.join(names)}, "
            f"but has {', '.join(map(str, sigma))}."
        )
    columns = (np.atleast_1d(as_numbers(sigma[key])) for key in keys)
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _sigmas(sigma: Any, y: np.ndarray) -> np.ndarray | None:
    if sigma is None:
        return None
    s, shape = as_numbers(sigma), y.shape
    if s.ndim == 1 and s.shape[0] == shape[0] == shape[1] > 1:
        raise ValueError(
            f"`sigma` must say whether it is of rows or of columns where there are {s.shape[0]} of both: give it the "
            f"shape ({s.shape[0]}, 1) for one in each row, or (1, {s.shape[0]}) for one in each column."
        )
    s = s[:, None] if s.ndim == 1 and s.shape[0] == shape[0] != shape[1] else s
    try:
        s = np.broadcast_to(s, shape).copy()
    except ValueError as error:
        raise ValueError(f"`sigma` must broadcast to shape {shape}, but has shape {s.shape}.") from error
    s[np.isnan(y)] = 1.0  # nothing was measured there, however exactly
    _must_be_positive("sigma", s, " wherever there is a value")
    return s


def _must_be_positive(name: str, s: np.ndarray, where: str = "") -> None:
    wrong = np.argwhere(~((s > 0) & np.isfinite(s)))
    if wrong.size:
        first = s[tuple(wrong[0])]
        raise ValueError(
            f"`{name}` must be positive and finite{where}, but is {first:g} at {rows_told(np.unique(wrong[:, 0]))}."
        )


def _event_columns(events: np.ndarray, sigma: Any, contacts: Any) -> tuple[np.ndarray, np.ndarray]:
    if events.size and sigma is None:
        raise ValueError("`event_sigma` must be given with `event_times`: it says how times weigh against values.")
    s = np.broadcast_to(as_numbers(1.0 if sigma is None else sigma), events.shape).copy()
    _must_be_positive("event_sigma", s)
    return s, np.broadcast_to(np.asarray(contacts, int), events.shape).copy()
