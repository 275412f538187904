"""A fit in pictures."""

import itertools
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..export.names import split_unit
from ..plot.figure import legend_above, new_figure, whole_ticks
from ..system import AbstractHybridSystem

_FEW_EVENTS = 30
"""The lines of more events than that are drawn fainter."""
_DENSE = 450
"""Times at which the fitted motion is drawn: with two for each event still fewer than 512, for which it compiles."""


def plot_fit(result: Any) -> Figure:
    """A figure of a `FitResult`: data and fit with the events marked, residuals, and the loss at every iteration. Where
    event times alone were measured, there are no data to draw over time."""
    panels = [_plot_data, _plot_residuals, _plot_convergence]
    panels = panels if result.data.names else panels[1:]
    figure = new_figure((8, 3 * len(panels)))
    axes = figure.subplots(len(panels), 1)
    if len(panels) == 3:
        axes[1].sharex(axes[0])
    for draw, panel in zip(panels, axes, strict=True):
        draw(panel, result)
    return figure


def _plot_data(axes: Any, result: Any) -> None:
    data, times = result.data, _dense_times(result)
    fitted = result.predict(times)
    for i, name in enumerate(data.names):
        line = axes.plot(times, fitted[:, i], linewidth=1.0, label=name)[0]
        axes.plot(data.times, data.values[:, i], ".", color=line.get_color(), alpha=0.5)
    _mark_events(axes, result)
    _label(axes, _time(result), "data (dots) and fit (lines); dashed lines are events")
    axes.set_ylabel(_ordinate(data.names))


def _dense_times(result: Any) -> np.ndarray:
    """Close to each other, and on both sides of every event: a line through the times measured would cut its corner."""
    start, end = result.horizon
    events = _event_times(result)
    before = events - 1e-9 * (end - start)
    return np.unique(np.clip(np.concatenate([np.linspace(start, end, _DENSE), events, before]), start, end))


def _time(result: Any) -> str:
    """Scenes count in seconds, systems in what they like."""
    return "time" if isinstance(result.scene, AbstractHybridSystem) else "time [s]"


def _ordinate(names: Any) -> str:
    """The name of a column that is alone; of several the unit, if it is one."""
    return str(names[0]) if len(names) == 1 else _unit(names)


def _unit(names: Any) -> str:
    """The unit of all columns, "[m]"; "" where they have none, or several."""
    units = {split_unit(name)[1] for name in names}
    return f"[{units.pop()}]" if len(units) == 1 and None not in units else ""


def _plot_residuals(axes: Any, result: Any) -> None:
    for i, name in enumerate(result.data.names):
        axes.plot(result.data.times, result.residuals[:, i], ".", label=name)
    if result.event_residuals.size:
        unit = _time(result).removeprefix("time")
        axes.plot(result.data.event_times, result.event_residuals, "x", label=f"event times{unit}")
    axes.axhline(0, color="black", linewidth=0.8)
    _mark_events(axes, result)
    alone = "" if result.data.names else "; dashed lines are events"
    _label(axes, _time(result), f"residuals (model - measurement){alone}")
    axes.set_ylabel("" if result.event_residuals.size else f"residual {_unit(result.data.names)}".strip())


def _plot_convergence(axes: Any, result: Any) -> None:
    """A line for each stage: their losses are not those of one problem."""
    if result.starts is not None:
        return _plot_starts(axes, result)
    loss, first = np.array([line.loss for line in result.history]), 0
    for _, lines in itertools.groupby(result.history, key=lambda line: line.stage):
        end = first + len(list(lines))
        axes.semilogy(np.arange(first, end), loss[first:end], ".-", color="C0")
        first = end
    changed = [i for i, line in enumerate(result.history) if line.sequence_changed]
    if changed:
        axes.semilogy(changed, loss[changed], "o", fillstyle="none", color="C1", label="event sequence changed")
    axes.xaxis.set_major_locator(whole_ticks())
    several = len({line.stage for line in result.history}) > 1
    _label(axes, "iteration", "loss, stage by stage" if several else "loss: half the sum of squares")


def _plot_starts(axes: Any, result: Any) -> None:
    """The losses at which the starts ended, in their order: those on one level have found the same minimum."""
    loss, converged = np.asarray(result.starts.loss), np.asarray(result.starts.converged)
    order = np.argsort(loss)[: np.isfinite(loss).sum()]
    place = 1 + np.arange(order.size)
    axes.semilogy(place, loss[order], "-", color="0.8", linewidth=1.0, zorder=1)
    for chosen, marker, label in ((converged[order], "o", "converged"), (~converged[order], "x", "not converged")):
        if chosen.any():
            axes.semilogy(place[chosen], loss[order][chosen], marker, color="C0", label=label)
    axes.axhline(result.loss, color="C1", linewidth=1.0, label="the fit")
    axes.xaxis.set_major_locator(whole_ticks())
    _label(axes, "start, in the order of their losses", "loss at which each start ended")


def _label(axes: Any, below: str, title: str) -> None:
    """What is drawn, to the left, and names beside it, where they cover nothing."""
    axes.set_xlabel(below)
    axes.set_title(title, loc="left", fontsize="medium")
    legend_above(axes)


def _mark_events(axes: Any, result: Any) -> None:
    times = _event_times(result)
    alpha = min(1.0, _FEW_EVENTS / max(len(times), 1))  # many lines would cover the data
    for time in times:
        axes.axvline(time, color="gray", linestyle="--", linewidth=0.8, alpha=alpha, zorder=0)


def _event_times(result: Any) -> np.ndarray:
    events = result.trajectory.events
    return np.asarray(events.time)[: int(events.count)]
