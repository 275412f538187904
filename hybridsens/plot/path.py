"""Paths of a motion: over two of its coordinates, as of a body in the plane, or in the phase plane of one."""

import operator
from collections.abc import Sequence
from typing import Any, SupportsIndex

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..export.names import coordinate_names, split_unit
from ..mechanics.mode import EventKind
from ..mechanics.scene import AbstractScene
from ..mechanics.trajectory import Trajectory
from .figure import COLOURS, legend_above, must_be_sampled, one_panel
from .motion import with_events


def plot_path(
    scene: AbstractScene,
    trajectory: Trajectory,
    x: SupportsIndex | str = 0,
    y: SupportsIndex | str = 1,
    axes: Axes | None = None,
) -> Figure:
    """One coordinate over another. Impacts are triangles; the start is a circle, the end a square. Coordinates in one
    unit have one scale, so that angles are right.

    Arguments: the scene; its trajectory with samples; two coordinates, by number or by name, with or without a unit;
    axes to draw in, or None for a new figure.
    Returns: the figure. Raises: ValueError without samples, for a batch, or for a coordinate that there is not;
    TypeError for axes that are none.
    """
    must_be_sampled(trajectory)
    names, _ = coordinate_names(scene, trajectory.final.q.shape[0])
    across, up = (_coordinate_number(coordinate, names) for coordinate in (x, y))
    axes = one_panel(axes)
    if split_unit(names[across])[1] == split_unit(names[up])[1]:
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(names[across])
    axes.set_ylabel(names[up])
    _, q, *_ = with_events(trajectory)
    places = lambda q: (q[:, across], q[:, up])
    return _draw(axes, places(q), [(*places(trajectory.events.before.q[_struck(trajectory)]), "v", "impact")])


def plot_phase(
    scene: AbstractScene, trajectory: Trajectory, coordinate: SupportsIndex | str = 0, axes: Axes | None = None
) -> Figure:
    """A coordinate's velocity against the coordinate. Impacts are jumps between two triangles; the start is a circle,
    the end a square.

    Arguments: the scene; its trajectory with samples; the coordinate, by its number or its name, with or without
    its unit; axes to draw in, or None for a new figure.
    Returns: the figure. Raises: ValueError without samples, for a batch, or for a coordinate that there is not;
    TypeError for axes that are none.
    """
    must_be_sampled(trajectory)
    names, rates = coordinate_names(scene, trajectory.final.q.shape[0])
    number = _coordinate_number(coordinate, names)
    axes = one_panel(axes)
    axes.locator_params(axis="x", nbins=6)  # long numbers of a narrow range lie on one another
    axes.set_xlabel(names[number])
    axes.set_ylabel(rates[number])
    _, q, v, _ = with_events(trajectory)
    struck, events = _struck(trajectory), trajectory.events
    places = lambda q, v: (q[:, number], v[:, number])
    sides = ((events.before, "v", "before an impact"), (events.after, "^", "after it"))
    jumps = [(*places(side.q[struck], side.v[struck]), marker, label) for side, marker, label in sides]
    return _draw(axes, places(q, v), jumps)


def _draw(axes: Axes, path: tuple, impacts: Sequence[tuple[Any, Any, str, str]]) -> Figure:
    """The path from its start to its end, with the impacts on it: places across and up, marker, label."""
    x, y = map(np.asarray, path)
    axes.plot(x, y, color=COLOURS[0], linewidth=1.2)
    for across, up, marker, label in impacts:
        if across.size:
            axes.plot(across, up, marker, color=COLOURS[1], markersize=5, label=label)
    axes.plot(x[:1], y[:1], "o", markerfacecolor="white", color=COLOURS[0], label="start")
    axes.plot(x[-1:], y[-1:], "s", markersize=4, color=COLOURS[0], label="end")
    legend_above(axes, columnspacing=1, handletextpad=0.2)
    return axes.get_figure(root=True)  # type: ignore[return-value]


def _struck(trajectory: Trajectory) -> np.ndarray:
    """Which events are impacts."""
    return np.isin(np.asarray(trajectory.events.kind), (EventKind.IMPACT, EventKind.CAPTURE))


def _coordinate_number(coordinate: SupportsIndex | str, names: list[str]) -> int:
    """The number of a coordinate, by that or by its name, with or without its unit. Raises: ValueError for none."""
    if isinstance(coordinate, str):
        for known in (names, [split_unit(name)[0] for name in names]):
            if coordinate in known:
                return known.index(coordinate)
        raise ValueError(f"`coordinate` must be one of {', '.join(names)}, but is {coordinate}.")
    number = operator.index(coordinate)
    if not 0 <= number < len(names):
        raise ValueError(f"`coordinate` must be one of 0 to {len(names) - 1}, but is {coordinate}.")
    return number
