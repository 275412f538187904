"""Pictures of a sweep: maps over two parameters, and the bifurcation diagram over one."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, SymLogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator

from ..parameters import split_name
from ..plot.figure import legend_above, new_figure, whole_ticks
from .dataset import gradients

if TYPE_CHECKING:
    import xarray as xr


MANY, CROWDED = 100, 0.5
"""Of more sides of cells than that no line is drawn where this part of them would have one: they would hide the map."""


def plot_sweep(dataset: "xr.Dataset") -> Figure:
    """Maps of J, of dJ/dp for both varied parameters, and of the number of events, over a grid of two parameters.

    A derivative of both signs is red above 0 and blue below, on a logarithmic scale of either sign; of another one the
    size is drawn, |dJ/dp|.
    Lines separate regions with different sequences of events, unless almost each point has its own: J has a kink or a
    jump there. Failed points are hatched. A line below says so. Units are those that `sweep` was given.
    Raises: ValueError unless the points are a grid of two parameters (choose with `dataset.sel` or `.isel`).
    """
    dims = dataset.J.dims
    if len(dims) != 2 or any(dim not in dataset.coords for dim in dims):
        one = ": over one parameter draw `dataset.J.plot()`, or `plot_bifurcation`" if len(dims) == 1 else ""
        if dims == ("point",):
            some = next((str(name) for name in dataset.coords if name != "point"), "mass")
            one = f": of points that are no grid draw `dataset.plot.scatter(x={some!r}, y='J')`"
        raise ValueError(f"A map must have a grid of two parameters, but the points have the dimensions {dims}{one}.")
    dataset = dataset.sortby(list(dims))  # the cells of a map lie beside each other
    maps = {"J": dataset.J}
    derivatives = gradients(dataset)
    for dim in map(str, dims):
        name, entry = split_name(dim)
        if name in derivatives:
            inner = [axis for axis in derivatives[name].dims if axis not in dims]
            chosen = derivatives[name][dict(zip(inner, entry or (), strict=True))]
            of_both_signs = bool((chosen > 0).any() and (chosen < 0).any())
            shown = chosen if of_both_signs else abs(chosen).assign_attrs(chosen.attrs)
            maps[f"dJ/d {dim}" if of_both_signs else f"|dJ/d {dim}|"] = shown
    if "event_count" in dataset:
        maps["events"] = dataset.event_count.where(dataset.J.notnull())
    lines, borders = _borders(dataset)
    columns = 2 if len(maps) > 3 else len(maps)
    rows = -(-len(maps) // columns)
    figure = new_figure((4.2 * columns, 3.4 * rows))
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, (title, values) in zip(panels, maps.items(), strict=len(maps) == panels.size):
        draw_map(axes, values, logarithmic=title.startswith("|"), signed=title.startswith("dJ"))
        axes.set_title(_with_units(title, values), fontsize="medium")
        colour = "0.2" if title.startswith("dJ") else "white"  # which is the 0 of a signed map
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.8), autolim=False)
    if told := "; ".join([*([borders] if borders else []), *unknowns(maps, "interrupted" in dataset.attrs)]):
        figure.supxlabel(told, fontsize="small", x=0.99, ha="right")
    return figure


def _borders(dataset: "xr.Dataset") -> tuple[list, str]:
    """Lines between neighbouring points whose motions have different sequences of events, and what is said of them."""
    if "event_sequence" not in dataset:
        return [], ""
    sequence = dataset.event_sequence
    x, y = (_edges(sequence[dim].values) for dim in sequence.dims)
    lines = border_lines(x, y, sequence.values)
    sides = 2 * sequence.size - sum(sequence.shape)
    if sides >= MANY and len(lines) >= CROWDED * sides:
        return [], "almost each point has a sequence of its own"
    return lines, "lines: between sequences of events" if lines else ""


def unknowns(maps: Mapping[str, "xr.DataArray"], interrupted: bool) -> list[str]:
    """What the hatched points of maps are, in words."""
    none = maps["J"].isnull().values
    why = "failed, or not computed" if interrupted else "failed"
    told = [f"hatched: {why}"] if none.any() else []
    if any((values.isnull().values & ~none).any() for values in maps.values()):
        told.append("hatched where J is not: no derivative")
    return told


def draw_map(axes: Axes, values: "xr.DataArray", logarithmic: bool = False, signed: bool = False) -> None:
    """A coloured map of (x, y) values with its colour bar; of `signed` ones, which are of both signs, on a logarithmic
    scale of either."""
    x, y = (str(dim) for dim in values.dims)
    logarithmic = logarithmic and bool(np.any(values.values > 0))
    edges = _edges(values[x].values), _edges(values[y].values)
    drawn = np.ma.masked_invalid(values.values.T.astype(float))
    whole = np.issubdtype(values.dtype, np.integer) or values.name == "event_count"
    norm, ticks, extend, colours = None, whole_ticks() if whole else None, "neither", None
    if signed:
        norm, ticks, extend = _of_both_signs(drawn.compressed())
        colours = "RdBu_r"
    elif logarithmic:
        positive = drawn[drawn > 0].compressed()
        norm, ticks = LogNorm(positive.min(), positive.max()), _log_ticks(positive)
        if (drawn == 0).any():  # no failed point, which is hatched: it lies below all others
            drawn, extend = np.ma.where(drawn == 0, positive.min() / 2, drawn), "min"
    uniform = not logarithmic and drawn.count() > 0 and drawn.min() == drawn.max()
    axes.patch.set(facecolor="0.85", edgecolor="0.6", hatch="////")  # what shows where there is no number
    mesh = axes.pcolormesh(*edges, drawn, norm=norm, cmap=colours, rasterized=True)
    shown_as = "%.4g" if signed else "%.3g" if logarithmic else None
    if uniform:  # a bar would show other numbers beside the one that there is
        axes.text(0.5, 0.5, f"{drawn.min():.4g}", transform=axes.transAxes, ha="center", va="center", color="white")
    else:
        axes.figure.colorbar(mesh, ax=axes, ticks=ticks, format=shown_as, extend=extend).minorticks_off()
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel(_label(values[x]))
    axes.set_ylabel(_label(values[y]))
    axes.label_outer()


def _of_both_signs(values: np.ndarray) -> tuple[SymLogNorm, np.ndarray, str]:
    """A scale for numbers of both signs, its ticks, and which of its ends numbers lie beyond: single huge ones, as
    beside a grazing impact, leave the rest of a map its colours."""
    sizes = np.abs(values)
    most = min(sizes.max(), 10 * np.quantile(sizes, 0.95) or np.inf)
    least = most / 100
    decades = 10.0 ** np.arange(np.ceil(np.log10(1.2 * least)), np.log10(most / 1.2))
    ticks = np.concatenate([[0.0], decades, [most]])
    extend = {0: "neither", 1: "max", 2: "min", 3: "both"}[(values.max() > most) + 2 * (values.min() < -most)]
    return SymLogNorm(least, vmin=-most, vmax=most), np.unique([-ticks, ticks]), extend


def _log_ticks(values: np.ndarray) -> np.ndarray:
    """Both ends, and round numbers between that keep their distance from these."""
    low, high = values.min(), values.max()
    steps = (1, 2, 5) if high < 100 * low else (1,)
    between = LogLocator(subs=steps, numticks=6).tick_values(low, high)
    apart = (high / low) ** 0.08
    return np.unique([low, *between[(between > low * apart) & (between < high / apart)], high])


def border_lines(x: np.ndarray, y: np.ndarray, sequence: np.ndarray) -> list:
    """Sides ((x, y), (x, y)) of the cells [x[i], x[i+1]] x [y[j], y[j+1]] across which `sequence` (i, j) changes."""
    upright = [[(x[i + 1], y[j]), (x[i + 1], y[j + 1])] for i, j in np.argwhere(sequence[1:] != sequence[:-1])]
    level = [[(x[i], y[j + 1]), (x[i + 1], y[j + 1])] for i, j in np.argwhere(sequence[:, 1:] != sequence[:, :-1])]
    return upright + level


def plot_bifurcation(
    dataset: "xr.Dataset", state: str | None = None, component: int = 0, axes: Axes | None = None
) -> Figure:
    """Bifurcation diagram: a state at each of the times asked for, over one parameter.

    Arguments: a sweep over one parameter with `states=True`, at times one period of the forcing apart, after the motion
    has settled; the name of a state, as "v" or "x.current" (default: "q", or a system's only one), and its component. A
    cross at the foot marks a point without a motion. Raises ValueError if the Dataset is not of that kind.
    """
    state = _sampled_state(dataset, state)
    values, named = dataset[state], state
    if values.dims[-1] != "sample":  # one of its coordinates
        count = values.shape[-1]
        if component not in range(count):
            raise ValueError(f"`component` must be one of the {count} of {state}, from 0, but is {component!r}.")
        columns = values.attrs.get("columns", [f"{state}[{i}]" for i in range(count)])
        named = np.atleast_1d(columns)[component]  # of a netCDF file a list of one text is that text
        values = values.isel({values.dims[-1]: component})
    if values.ndim != 2:
        raise ValueError(
            f"A bifurcation diagram must have one parameter, but the points have the dimensions {values.dims[:-1]}."
        )
    (parameter,) = (dim for dim in values.dims if dim != "sample")
    if axes is None:
        axes = new_figure((7, 4)).subplots()
    x = np.repeat(dataset[parameter].values, values.sizes["sample"])
    axes.plot(
        x, values.transpose(parameter, "sample").values.ravel(), ",k" if x.size > 20_000 else ".k", markersize=1.5
    )
    failed = dataset[parameter].values[values.isnull().all("sample").values]
    if failed.size:
        at_the_foot = {"transform": axes.get_xaxis_transform(), "clip_on": False}
        axes.plot(failed, np.zeros(failed.size), "x", color="#c8553d", label="failed", **at_the_foot)
        legend_above(axes)
    axes.set_xlabel(_label(dataset[parameter]))
    axes.set_ylabel(f"{named}, sampled")
    return axes.figure  # pyright: ignore[reportReturnType]


def _sampled_state(dataset: "xr.Dataset", wanted: str | None) -> str:
    """The state that is to be drawn."""
    kept = [str(name) for name, values in dataset.items() if "sample" in values.dims and name != "sample_time"]
    if wanted in kept:
        return wanted
    if wanted is None and ("q" in kept or len(kept) == 1):
        return "q" if "q" in kept else kept[0]
    if not kept:
        raise ValueError("A bifurcation diagram must have states, but the sweep kept none: use states=True.")
    given = "is not told which" if wanted is None else f"is told {wanted!r}"
    names = ", ".join(f"state={name!r}" for name in kept)
    raise ValueError(f"A bifurcation diagram must have one of the states that were kept, but {given}: say {names}.")


def _edges(centres: np.ndarray) -> np.ndarray:
    """Borders of the cells around grid points: halfway between them."""
    if centres.size == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _label(coordinate) -> str:
    return _with_units(str(coordinate.name), coordinate)


def _with_units(name: str, values) -> str:
    units = values.attrs.get("units")
    return f"{name} [{units}]" if units else name
