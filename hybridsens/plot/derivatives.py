"""Pictures of derivatives: gradients by several methods as bars, and the costate along a motion."""

from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Array, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..export.names import coordinate_names, split_unit
from ..mechanics.scene import AbstractScene, State
from ..mechanics.trajectory import Trajectory
from ..outcome import end_told
from ..validation.caller import warn_caller
from ..waiting import waiting
from .figure import legend_above, line, must_be_sampled, new_figure

ROUNDING = 1e-10
"""A derivative that is so much smaller than the largest one is drawn as zero."""


def plot_gradients(axes: Axes, names: list[str], gradients: dict[str, Float[np.ndarray, "parameter"]]) -> None:
    """Derivatives per parameter as one bar for each method; each parameter is scaled by the largest of its bars."""
    fills = (("#14213d", ""), ("white", ""), ("#e6a57e", "////"), ("0.8", "...."))
    scale = np.max(np.abs(np.stack(list(gradients.values()))), axis=0)
    scale[scale <= ROUNDING * np.max(scale, initial=0)] = np.inf  # a zero, by methods that leave rounding
    height = 0.8 / len(gradients)
    for i, (label, values) in enumerate(gradients.items()):
        face, hatch = fills[i % len(fills)]
        places = np.arange(len(names)) + (i - (len(gradients) - 1) / 2) * height
        look = {"facecolor": face, "hatch": hatch, "edgecolor": "#14213d", "linewidth": 0.8}
        axes.barh(places, values / scale, height, label=label, **look)
    axes.set_xlim(-1.1, 1.1)
    axes.set_xticks([-1, 0, 1])
    axes.axvline(0, color="black", linewidth=0.8)
    axes.set_yticks(np.arange(len(names)), [name.replace("_", " ") for name in names])
    axes.set_xlabel("dJ/dtheta, scaled per parameter")
    axes.invert_yaxis()
    legend_above(axes, columnspacing=1, handlelength=1.5)


def costate(trajectory: Trajectory, cost: Callable[[Trajectory], Array], *, progress: bool = True) -> State:
    """dJ/dq(t) and dJ/dv(t) at every sample of a motion, as a `State` of arrays (sample, dof).

    The motion is started again at each sample and followed to t1, and `cost` of what follows is differentiated by the
    state there. So J must be made of what follows: the final state, or a running cost. While a contact is held, only
    changes along it count. A sample at t1, where nothing follows, is nan. `progress`: show for how long it compiles and
    runs.

    Raises: ValueError without samples, for a batch, for a motion that broke off, or for one that does not know its
    scene (see `Trajectory.evaluate`).
    """
    must_be_sampled(trajectory)
    if not trajectory.status.reached_end:  # begun again at a sample it has room for more events, and ends elsewhere
        told = end_told(trajectory)
        raise ValueError(f"A costate must be that of a motion that reached t1, but this one did not.{told}")
    with waiting("compiling the costate and following it from each sample", progress):
        found = jax.block_until_ready(trajectory.from_each_sample(cost))
    lost = np.isnan(np.asarray(found.q)).any(1) & (np.asarray(trajectory.ts) < trajectory.end_time)
    if lost.any():
        warn_caller(
            f"The costate is nan at {lost.sum()} of {lost.size} samples: from there the motion has no room to t1, or "
            "its derivative has none (raise `max_steps`), or the cost of it is no number."
        )
    return found


def plot_costate(
    scene: AbstractScene, trajectory: Trajectory, cost: Callable[[Trajectory], Array], *, progress: bool = True
) -> Figure:
    """The costate over time, one line for each coordinate, above those of the velocities. It jumps at impacts, where
    the lines are broken.

    Arguments: the scene; its trajectory with samples (`ts=`), which should be dense; `cost(trajectory) -> J`;
    `progress` as for `costate`. Returns: the figure. Raises: as `costate`.
    """
    found = costate(trajectory, cost, progress=progress)
    figure = new_figure((8, 5))
    t, n = np.asarray(trajectory.ts), int(trajectory.events.count)
    times = np.asarray(trajectory.events.time[:n])
    names = coordinate_names(scene, trajectory.final.q.shape[0])
    pieces = np.split(np.arange(t.size), np.searchsorted(t, times))
    for axes, values, labels in zip(figure.subplots(2, 1, sharex=True), (found.q, found.v), names, strict=True):
        for i, label in enumerate(labels):
            for k, piece in enumerate(pieces):
                name = None if k else split_unit(label)[0]  # the unit is another one, that of J by this one's
                axes.plot(t[piece], np.asarray(values[piece, i]), **line(i), label=name)
        for time in times:
            axes.axvline(time, color="0.8", linewidth=0.7, zorder=0)
        legend_above(axes)
    above, below = figure.axes
    above.set_ylabel("dJ/dq")
    below.set(ylabel="dJ/dv", xlabel="time [s]")
    return figure
