"""A fit in pictures."""

import itertools
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..plot.figure import new_figure


def plot_fit(result: Any) -> Figure:
    """A figure of a `FitResult`: data and fit with the events marked, residuals, and the loss at every iteration."""
    figure = new_figure((8, 9))
    above, middle, below = figure.subplots(3, 1)
    _plot_data(above, result)
    _plot_residuals(middle, result)
    _plot_convergence(below, result)
    return figure


def _plot_data(axes: Any, result: Any) -> None:
    data = result.data
    for i, name in enumerate(data.names):
        line = axes.plot(data.times, result.predictions[:, i], label=f"{name}, fit")[0]
        axes.plot(data.times, data.values[:, i], ".", color=line.get_color(), alpha=0.5, label=f"{name}, measured")
    _mark_events(axes, result)
    axes.set(xlabel="t [s]", title="data and fit; dashed lines are events")
    if data.names:
        axes.legend()


def _plot_residuals(axes: Any, result: Any) -> None:
    for i, name in enumerate(result.data.names):
        axes.plot(result.data.times, result.residuals[:, i], ".", label=name)
    if result.event_residuals.size:
        axes.plot(result.data.event_times, result.event_residuals, "x", label="event times")
    axes.axhline(0, color="black", linewidth=0.8)
    _mark_events(axes, result)
    axes.set(xlabel="t [s]", title="residuals (model - measurement)")
    axes.legend()


def _plot_convergence(axes: Any, result: Any) -> None:
    """A line for each stage: their losses are not those of one problem."""
    loss, first = np.array([line.loss for line in result.history]), 0
    for _, lines in itertools.groupby(result.history, key=lambda line: line.stage):
        end = first + len(list(lines))
        axes.semilogy(np.arange(first, end), loss[first:end], ".-", color="C0")
        first = end
    changed = [i for i, line in enumerate(result.history) if line.sequence_changed]
    axes.semilogy(changed, loss[changed], "o", fillstyle="none", color="C1", label="event sequence changed")
    axes.set(xlabel="evaluation", title="loss, stage by stage")
    if changed:
        axes.legend()


def _mark_events(axes: Any, result: Any) -> None:
    events = result.trajectory.events
    for time in np.asarray(events.time)[: int(events.count)]:
        axes.axvline(time, color="gray", linestyle="--", linewidth=0.8)
