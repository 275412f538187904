"""The picture of many motions at once: where most of them are, over time."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..export.names import coordinate_names
from ..export.trees import named_leaves
from ..mechanics.trajectory import Trajectory
from ..solution import Solution
from .figure import COLOURS, legend_above, new_figure

MOST = 8
"""Entries of one leaf that are drawn."""

BANDS = ((0.05, 0.95, 0.25, "nine of ten"), (0.25, 0.75, 0.4, "half"))
"""From which part of the motions to which, how dark, and what it is called."""


def plot_fan(motions: Trajectory | Solution, scene: Any = None) -> Figure:
    """Each coordinate of a batch of motions over time: the median, and where half and nine of ten of them are.

    Arguments: what `jax.vmap` of `simulate` or `solve` returned, with the same samples (`ts=`) for all; the scene that
    moved, for the names of its coordinates. Motions that did not reach their end are left out, and told of.
    Returns: a figure with a row for each coordinate, of a system for each entry of its state.
    Raises: ValueError for one motion, without samples, or where none reached its end; TypeError for what is no motion.
    """
    t = _times_of_all(motions)
    whole = np.asarray(motions.status.reached_end)
    if not whole.any():
        raise ValueError(f"At least one of the motions must reach its end, but these are: {motions.status}.")
    columns = _columns(motions, scene, whole)
    figure = new_figure((8, 1.2 + 1.8 * len(columns)))
    panels = figure.subplots(len(columns), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (name, values) in zip(panels, columns.items(), strict=True):
        for low, high, alpha, label in BANDS:
            ends = np.quantile(values, (low, high), axis=0)
            axes.fill_between(t, *ends, color=COLOURS[0], alpha=alpha, linewidth=0, label=label)
        axes.plot(t, np.median(values, axis=0), color=COLOURS[1], linewidth=1.4, label="median")
        axes.set_ylabel(name)
    legend_above(panels[0])
    left_out = f", {np.sum(~whole)} that failed left out" if not whole.all() else ""
    panels[0].set_title(f"{np.sum(whole)} motions{left_out}", loc="left", fontsize="small")
    panels[-1].set_xlabel("time [s]" if isinstance(motions, Trajectory) else "time")
    return figure


def _times_of_all(motions: Any) -> np.ndarray:
    """The times of the samples, which all motions have in common."""
    if not isinstance(motions, Trajectory | Solution):
        raise TypeError(
            "`motions` must be a batch of motions, as `jax.vmap` of `simulate` or `solve` returns it, but is "
            f"{type(motions).__name__}."
        )
    if motions.ts is None:
        raise ValueError("`motions` must have samples to be drawn, but have none: pass `ts=` where they are made.")
    ts = np.asarray(motions.ts)
    if ts.ndim != 2 or ts.size == 0:
        raise ValueError(f"`motions` must be a batch of one axis with samples, but `ts` has the shape {ts.shape}.")
    if (ts != ts[0]).any():
        raise ValueError("`motions` must have the same samples, but their `ts` differ.")
    return ts[0]


def _columns(motions: Trajectory | Solution, scene: Any, whole: np.ndarray) -> dict[str, np.ndarray]:
    """Name -> values (run, sample) of the motions that are whole."""
    if isinstance(motions, Trajectory):
        q = np.asarray(motions.q)[whole]
        return dict(zip(coordinate_names(scene, q.shape[-1])[0], np.moveaxis(q, -1, 0), strict=True))
    found = {}
    for name, leaf in named_leaves("x", motions.x).items():
        rows = leaf[whole].reshape(np.sum(whole), leaf.shape[1], -1)[..., :MOST]
        entries = np.moveaxis(rows, -1, 0)
        found |= {name: entries[0]} if leaf.ndim == 2 else {f"{name}[{k}]": x for k, x in enumerate(entries)}
    return found
