"""Pictures of coordinates: over time, and as a path in the phase plane."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..export.names import coordinate_names
from ..mechanics.mode import EventKind
from ..mechanics.scene import AbstractScene
from ..mechanics.trajectory import Trajectory
from .figure import LINES, must_be_sampled, new_figure
from .motion import with_events


def plot_coordinates(scene: AbstractScene, trajectory: Trajectory) -> Figure:
    """Each coordinate and its velocity over time, by the names of `scene.coordinates`; events are thin vertical lines.

    Arguments: the scene that moved; its trajectory with samples (`ts=`), which should be dense.
    Returns: a figure with a row for each coordinate. Raises: ValueError without samples, or for a batch.
    """
    must_be_sampled(trajectory)
    t, q, v = with_events(trajectory)
    dof = q.shape[1]
    figure = new_figure((9, 1.2 + 1.7 * dof))
    rows = figure.subplots(dof, 2, sharex=True, squeeze=False)
    times = np.asarray(trajectory.events.time[: int(trajectory.events.count)])
    for i, names in enumerate(zip(*coordinate_names(scene, dof), strict=True)):
        for axes, values, name in zip(rows[i], (q, v), names, strict=True):
            axes.plot(t, np.asarray(values[:, i]), color=LINES[0][0], linewidth=1.4)
            axes.set_ylabel(name)
            for time in times:
                axes.axvline(time, color="0.8", linewidth=0.7, zorder=0)
    for axes in rows[-1]:
        axes.set_xlabel("time [s]")
    return figure


def plot_phase(
    scene: AbstractScene, trajectory: Trajectory, coordinate: int | str = 0, axes: Axes | None = None
) -> Figure:
    """A coordinate's velocity against the coordinate. Impacts are dotted jumps, the start is a circle.

    Arguments: the scene; its trajectory with samples; the coordinate, by its number or its name; axes to draw in, or
    None for a new figure.
    Returns: the figure. Raises: ValueError without samples, for a batch, or for a coordinate that there is not.
    """
    must_be_sampled(trajectory)
    names, rates = coordinate_names(scene, trajectory.final.q.shape[0])
    number = coordinate if isinstance(coordinate, int) else _number(coordinate, names)
    if not 0 <= number < len(names):
        raise ValueError(f"`coordinate` must be one of 0 to {len(names) - 1}, but is {coordinate}.")
    axes = new_figure((5.5, 5)).subplots() if axes is None else axes
    _, q, v = with_events(trajectory)
    q, v = np.asarray(q[:, number]), np.asarray(v[:, number])
    axes.plot(q, v, color=LINES[0][0], linewidth=1.2)
    _draw_jumps(axes, trajectory, number)
    axes.plot(q[:1], v[:1], "o", markerfacecolor="white", color=LINES[0][0], label="start")
    axes.set_xlabel(names[number])
    axes.set_ylabel(rates[number])
    axes.legend(frameon=False, fontsize="small")
    return axes.get_figure(root=True)  # type: ignore[return-value]


def _draw_jumps(axes: Axes, trajectory: Trajectory, number: int) -> None:
    """Dots at both ends of every impact."""
    n = int(trajectory.events.count)
    impacts = np.isin(np.asarray(trajectory.events.kind[:n]), (EventKind.IMPACT, EventKind.CAPTURE))
    before, after = trajectory.events.before, trajectory.events.after
    for state, marker, label in ((before, "v", "before an impact"), (after, "^", "after it")):
        q, v = (np.asarray(x[:n, number])[impacts] for x in (state.q, state.v))
        if q.size:
            axes.plot(q, v, marker, color=LINES[1][0], markersize=4, linestyle="none", label=label)


def _number(name: str, names: list[str]) -> int:
    if name not in names:
        raise ValueError(f"`coordinate` must be one of {', '.join(names)}, but is {name}.")
    return names.index(name)
