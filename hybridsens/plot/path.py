"""The path of a motion over two of its coordinates, as of a body in the plane."""

from typing import SupportsIndex

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..export.names import coordinate_names, split_unit
from ..mechanics.mode import EventKind
from ..mechanics.scene import AbstractScene
from ..mechanics.trajectory import Trajectory
from .figure import COLOURS, legend_above, must_be_sampled, one_panel
from .motion import coordinate_number, with_events


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
    across, up = (coordinate_number(coordinate, names) for coordinate in (x, y))
    axes = one_panel(axes)
    _, q, *_ = with_events(trajectory)
    struck = np.isin(np.asarray(trajectory.events.kind), (EventKind.IMPACT, EventKind.CAPTURE))
    at = np.asarray(trajectory.events.before.q)[struck]
    q = np.asarray(q)
    axes.plot(q[:, across], q[:, up], color=COLOURS[0], linewidth=1.2)
    if at.size:
        axes.plot(at[:, across], at[:, up], "v", color=COLOURS[1], markersize=5, label="impact")
    axes.plot(q[:1, across], q[:1, up], "o", markerfacecolor="white", color=COLOURS[0], label="start")
    axes.plot(q[-1:, across], q[-1:, up], "s", markersize=4, color=COLOURS[0], label="end")
    if split_unit(names[across])[1] == split_unit(names[up])[1]:
        axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(names[across])
    axes.set_ylabel(names[up])
    legend_above(axes, columnspacing=1, handletextpad=0.2)
    return axes.get_figure(root=True)  # type: ignore[return-value]
