"""What all pictures share: figures that a notebook shows, colours and lines, what can be drawn at all."""

import io
import sys
from typing import Any

import jax.core
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..mechanics.trajectory import Trajectory
from ..solution import Solution

COLOURS = ("#14213d", "#c8553d", "#5b8e7d", "#8d99ae")
STYLES = ("-", "--", "-.", ":")
ABOVE = {"loc": "lower right", "bbox_to_anchor": (1, 1), "frameon": False, "fontsize": "small", "borderaxespad": 0.1}
"""Legends stand above their axes, where no line can cross them."""


class Picture(Figure):
    """A Matplotlib figure that a notebook shows by itself, with pyplot imported or not."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png", dpi=100)
        return file.getvalue()


def new_figure(size: tuple[float | int, float | int]) -> Figure:
    """A figure of that many inches. Where `plt.show()` opens windows it is one of pyplot's, so that it is shown there;
    in a notebook it is not, since pyplot would show it a second time."""
    pyplot = sys.modules.get("matplotlib.pyplot")
    backend = "" if pyplot is None else pyplot.get_backend().lower()
    if pyplot is None or "inline" in backend or backend == "agg":
        return Picture(figsize=size, layout="constrained")
    return pyplot.figure(figsize=size, layout="constrained")


def one_panel(axes: Any) -> Axes:
    """The axes that are given, or those of a new figure. Raises: TypeError for what is neither axes nor None."""
    if axes is None:
        return new_figure((5.5, 5)).subplots()
    if not isinstance(axes, Axes):
        raise TypeError(
            f"`axes` must be axes of Matplotlib, or None for a new figure, but is {axes!r}. One coordinate over "
            "another is drawn by `plot_path`."
        )
    return axes


def line(number: int) -> dict[str, Any]:
    """Colour and style of a line: near ones differ in style too, so that they read in grey print, and 16 in one of
    both."""
    turns = number // len(COLOURS)
    return {"color": COLOURS[number % len(COLOURS)], "linestyle": STYLES[(number + turns) % len(STYLES)]}


_HANDLE, _LETTER = 0.5, 0.075
"""Widths of a legend's line and of a letter [inch]."""


def legend_above(axes: Any, **options: Any) -> None:
    """Names of what is drawn above the axes, in as many rows as they take; nothing where nothing has a name."""
    names = axes.get_legend_handles_labels()[1]
    if not names:
        return
    spec, width = axes.get_subplotspec(), 0.85 * axes.get_figure(root=True).get_figwidth()
    width /= 1 if spec is None else spec.get_gridspec().ncols
    fit = int(width / (_HANDLE + _LETTER * max(map(len, names))))
    axes.legend(ncols=max(1, min(fit, len(names))), **options, **ABOVE)


def whole_ticks() -> MaxNLocator:
    """Ticks at integers, of which one may be the only one in sight."""
    return MaxNLocator(integer=True, min_n_ticks=1)


def must_be_sampled(trajectory: Any) -> tuple[np.ndarray, np.ndarray]:
    """Times and configurations of the samples. Raises: ValueError where there are none, or of a batch; TypeError for
    what is no motion of a scene."""
    _must_come_from("trajectory", trajectory, Trajectory, "simulate", "what moved comes first, and its motion second")
    return _sample_times("trajectory", trajectory), np.asarray(trajectory.q)


def solution_times(solution: Any) -> np.ndarray:
    """Times of the samples. Raises: ValueError where there are none, or of a batch; TypeError for what is no motion of
    a system."""
    _must_come_from("solution", solution, Solution, "solve", "the motion is all that it takes")
    return _sample_times("solution", solution)


def _must_come_from(name: str, motion: Any, kind: type, maker: str, otherwise: str) -> None:
    if isinstance(motion, kind):
        return
    others = {Solution: "plot_solution(motion)", Trajectory: "plot_trajectory(scene, motion)"}
    remedy = f"it is drawn by {others[type(motion)]}" if type(motion) in others else otherwise
    raise TypeError(f"`{name}` must be a motion, as `{maker}` returns it, but is {type(motion).__name__}: {remedy}.")


def _sample_times(name: str, motion: Trajectory | Solution) -> np.ndarray:
    if isinstance(motion.events.count, jax.core.Tracer):
        raise ValueError("A motion is drawn outside of jax.jit, jax.grad and jax.vmap.")
    if motion.ts is None:
        raise ValueError(f"`{name}` must have samples to be drawn, but has none: pass `ts=` where it is made.")
    if motion.ts.ndim != 1:
        raise ValueError(
            f"`{name}` must be one motion, but is a batch of {motion.ts.shape[:-1]}: draw one of them, `{name}[0]`, or "
            f"where most of them are, `plot_fan({name})`."
        )
    if motion.ts.size == 0:
        raise ValueError(
            f"`ts` must hold at least one time where `{name}` is made, since its samples are drawn, but is empty."
        )
    return np.asarray(motion.ts)
