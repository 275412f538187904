"""Global sensitivity of J to the varied parameters, from the points of one sweep."""

import json
from typing import TYPE_CHECKING

import numpy as np

from ..parameters import split_name
from ..status import Status
from ..validation.caller import warn_caller
from .dataset import xarray

if TYPE_CHECKING:
    import xarray as xr


ROUNDINGS = 100
"""Results that differ by no more roundings of their size are the same."""
RESAMPLES = 500
"""Draws of the bootstrap."""


def sobol_indices(dataset: "xr.Dataset", value: str = "J", confidence: float = 0.95) -> "xr.Dataset":
    """Shares of the variance of J that the parameters have, alone (first order) and with all others (total order).

    S_i = Var(E[J | p_i]) / Var(J),   T_i = 1 - Var(E[J | all but p_i]) / Var(J)

    by the estimators (b) and (f) of Saltelli et al. 2010, table 2.

    Arguments: the result of a sweep over a `saltelli` design; the scalar result to explain; the level of the bootstrap
    intervals.
    Returns: first_order, total_order (parameter,) and their intervals (parameter, end).
    Raises: ValueError for another design, for points that are not all there in its order, or for a result that is no
    scalar or the same at all points. Rows with a failed point are left out, with a warning.
    """
    if dataset.attrs.get("design") != "saltelli":
        raise ValueError(
            f"Sobol indices need points of a `saltelli` design, but the design is {dataset.attrs.get('design')!r}."
        )
    names = _varied(dataset)
    _check_blocks(dataset, names)
    if not 0 < confidence < 1:
        raise ValueError(f"`confidence` must lie inside (0, 1), but is {confidence}.")
    rows = _complete(_scalar(dataset, value).reshape(len(names) + 2, -1))
    _check_varies(value, rows)
    rows = rows / np.max(np.abs(rows))  # shares have no unit, and squares of 1e-200 are 0
    ends = np.quantile(_resampled(rows), [(1 - confidence) / 2, (1 + confidence) / 2], axis=0)
    data = {}
    for order, name in enumerate(("first_order", "total_order")):
        data[name] = ("parameter", _estimates(rows)[order])
        data[f"{name}_interval"] = (("parameter", "end"), ends[:, order].T)
    return xarray().Dataset(data, {"parameter": names, "end": ["low", "high"]}, {"value": value})


def dgsm(dataset: "xr.Dataset") -> "xr.Dataset":
    """Derivative-based global sensitivity measures, and the bounds that they set to the total Sobol indices.

    nu_i = E[(dJ/dp_i)^2],   T_i <= nu_i (b_i - a_i)^2 / (pi^2 Var(J))        (Sobol and Kucherenko 2009, theorem 2)

    for p uniform in the box [a, b]. The bound needs a J without jumps over the box: a word tells where points differ in
    their sequence of events, at whose borders J may jump.
    Arguments: the result of a sweep over a `random`, `latin_hypercube`, `sobol` or `saltelli` design, with gradient.
    Points without a J or without a gradient (at grazing) are left out, with a warning.
    Raises: ValueError for points that were not drawn from a box, a sweep without gradient, or a J that is the same at
    all points.
    """
    names = _varied(dataset)
    derivatives = np.array([_derivative(dataset, name) for name in names])
    good = np.isfinite(dataset.J.values) & np.isfinite(derivatives).all(axis=0)
    if not good.all():
        warn_caller(
            f"{np.sum(~good)} of {good.size} points have no J or no gradient and are left out of the measures. Where "
            "they graze, gradients nearby are large, and the bounds come out too low."
        )
    _check_varies("J", dataset.J.values[good])
    _warn_of_borders(dataset, good)
    variance = np.var(dataset.J.values[good])
    squares = np.mean(derivatives[:, good] ** 2, axis=1)
    widths = np.array([dataset[name].attrs["highest"] - dataset[name].attrs["lowest"] for name in names])
    bound = squares * widths**2 / (np.pi**2 * variance)
    return xarray().Dataset(
        {"nu": ("parameter", squares), "total_order_bound": ("parameter", bound)}, {"parameter": names}
    )


def _varied(dataset) -> list[str]:
    """The varied parameters in the order of the design, which may not be that of the coordinates."""
    order = dataset.attrs.get("varied")
    if order is None:
        raise ValueError(
            "The Dataset must have the attribute `varied`, which `sweep` writes, but has none: its parameters would be "
            "mixed up. Run the sweep again, with a new `store`, and keep the attributes of its Dataset."
        )
    names = json.loads(order)
    if not all("lowest" in dataset[name].attrs for name in names):
        raise ValueError(f"The points must be drawn from a box, but the design is {dataset.attrs.get('design')!r}.")
    return names


def _check_blocks(dataset, names: list[str]) -> None:
    """The points must be A, B, and A with one column of B after the other, as `saltelli` made them."""
    points = np.stack([dataset[name].values for name in names])
    whole = points.shape[1] % (len(names) + 2) == 0
    if whole:
        a, b, *mixed = np.moveaxis(points.reshape(len(names), len(names) + 2, -1), 1, 0)
        own = np.eye(len(names), dtype=bool)[..., None]
        whole = all(np.array_equal(block, np.where(i, b, a)) for i, block in zip(own, mixed, strict=True))
    if not whole:
        raise ValueError(
            f"The points must be all those of the `saltelli` design in its order, but the {points.shape[1]} points are "
            "not: some are missing or in other places. Give the Dataset as `sweep` returned it."
        )


def _warn_of_borders(dataset, good: np.ndarray) -> None:
    """Tell where the points have several sequences of events: no derivative shows a jump between two of them."""
    sequences = np.unique(dataset.event_sequence.values[good]).size if "event_sequence" in dataset else 1
    if sequences > 1:
        warn_caller(
            f"The points have {sequences} sequences of events. If J jumps where one becomes another, its derivatives "
            "do not show it and the bounds come out too low: `sobol_indices` of a `saltelli` design see jumps too."
        )


def _scalar(dataset, value: str) -> np.ndarray:
    """The values of a result, one a point."""
    found = [name for name, result in dataset.data_vars.items() if result.dims == dataset.J.dims]
    if value not in found:
        raise ValueError(f"`value` must be the name of a scalar result, one of {', '.join(found)}, but is {value!r}.")
    # Counts of a motion that broke off are finite too.
    reached = np.asarray(Status(np.asarray(dataset.status.values, np.int64)).reached_end)
    return np.where(reached, dataset[value].values, np.nan)


def _check_varies(value: str, values: np.ndarray) -> None:
    rounding = ROUNDINGS * np.finfo(values.dtype).eps * np.max(np.abs(values), initial=0)
    if values.size and np.ptp(values) <= rounding:
        raise ValueError(
            f"{value} must vary over the points for parameters to have shares in its variance, but is "
            f"{values.flat[0]:.6g} at all of them, to rounding. Vary what it depends on, or over a wider box."
        )


def _derivative(dataset, name) -> np.ndarray:
    leaf, index = split_name(name)
    if f"dJ_d{leaf}" not in dataset:
        raise ValueError(
            f"The sweep must have the gradient by {leaf!r}, but has none; leave `gradient` at its default."
        )
    return dataset[f"dJ_d{leaf}"].values[(..., *(index or ()))]


def _estimates(rows: np.ndarray) -> np.ndarray:
    """First and total orders (2, parameter) from the values at A, B and A with one column of B (block, row)."""
    a, b, *mixed = rows - rows[:2].mean()  # less the mean, which makes the first order's error smaller
    variance = np.var(rows[:2])
    first = [np.mean(b * (ab - a)) / variance for ab in mixed]
    total = [np.mean((a - ab) ** 2) / (2 * variance) for ab in mixed]
    return np.array([first, total])


def _resampled(rows: np.ndarray) -> np.ndarray:
    """Estimates from rows drawn with replacement (the bootstrap), always the same draws."""
    rng = np.random.default_rng(0)
    count = rows.shape[1]
    return np.array([_estimates(rows[:, rng.integers(count, size=count)]) for _ in range(RESAMPLES)])


def _complete(rows):
    whole = np.isfinite(rows).all(axis=0)
    if not whole.all():
        warn_caller(f"{np.sum(~whole)} of {whole.size} rows have a failed point and are left out of the indices.")
    if whole.sum() < 2:
        raise ValueError(f"Sobol indices must have at least 2 rows without a failed point, but have {whole.sum()}.")
    return rows[:, whole]
