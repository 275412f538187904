"""The picture of a hybrid system's motion over time: states, modes, events."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from ..delays import DelayQueue
from ..export.trees import named_leaves
from ..solution import Solution
from ..validation.spelling import did_you_mean
from .figure import legend_above, line, new_figure, solution_times, whole_ticks

MOST = 8
"""Entries of one leaf that are drawn."""

MOST_NAMES = 16
"""Rows of events that are named."""

FEW = 3
"""Numbers in the mode that never exceed this share a panel: a counter among them would flatten the others."""


def plot_solution(solution: Solution, leaves: Sequence[str] | None = None) -> Figure:
    """A panel for each leaf of the state; of the mode one with a bar for each truth while it holds, one for the small
    numbers, one for each other number; and one with a tick for each event.

    Arguments: a solution with samples (`ts=`), which should be dense; names of the leaves to draw, as the panels have
    them, ["x.level", "mode.on"] (default: all but the places of a `DelayQueue`).
    Returns: the figure. Raises: ValueError if the solution has no samples, no leaf of a name, or is a batch; TypeError
    for a motion of `simulate`.
    """
    solution_times(solution)
    states, modes = _chosen(solution, leaves)
    figure = new_figure((8, 1.2 + 1.6 * (len(states) + len(modes) + 1)))
    _draw_panels(solution, figure, states, modes)
    return figure


def draw_solution(solution: Solution, figure: Figure | SubFigure) -> None:
    """The same of all leaves in a part of a figure."""
    _draw_panels(solution, figure, *_chosen(solution, None))


def _draw_panels(solution: Solution, figure: Figure | SubFigure, states: dict, modes: list[dict]) -> None:
    panels = len(states) + len(modes) + 1
    axes = list(np.atleast_1d(figure.subplots(panels, 1, sharex=True)))
    seen = _events_between_samples(solution)
    t, order = _times(solution, seen)
    before, after = _rows("x", solution.events.before), _rows("x", solution.events.after)
    for panel, (name, samples) in zip(axes, states.items(), strict=False):
        whole = np.concatenate([before[name][seen], after[name][seen], samples])[order]
        _draw(panel, t, whole, name)
    for panel, together in zip(axes[len(states) :], modes, strict=False):
        _draw_modes(panel, solution, together)
    _draw_events(axes[-1], solution)
    axes[-1].set_xlabel("time")


def _chosen(solution: Solution, leaves: Sequence[str] | None) -> tuple[dict, list[dict]]:
    """What is drawn of the state, and of the mode by panels. Raises: ValueError for a leaf that there is not."""
    states, modes = _rows("x", solution.x), _modes(solution)
    if leaves is None:
        return states, modes
    entries = [name for together in modes for name in together]
    known = list(dict.fromkeys([*states, *map(_leaf_of, entries), *entries]))
    if unknown := [name for name in leaves if name not in known]:
        raise ValueError(
            f"`leaves` must have names among {', '.join(known)}, but has {', '.join(map(str, unknown))}."
            f"{did_you_mean(unknown, known)}"
        )
    asked = lambda name: name in leaves or _leaf_of(name) in leaves
    kept = [{name: rows for name, rows in together.items() if asked(name)} for together in modes]
    return {name: states[name] for name in leaves if name in states}, [together for together in kept if together]


def _events_between_samples(solution: Solution) -> np.ndarray:
    """Numbers of the events from the first to the last sample: before and after, nothing is known between events."""
    time, ts = np.asarray(solution.events.time)[: int(solution.events.count)], np.asarray(solution.ts)
    return np.flatnonzero((time >= ts[0]) & (time <= ts[-1]))


def _times(solution: Solution, seen: np.ndarray):
    """Times of samples and of both sides of these events, sorted; sorting is stable: before, after, sample."""
    events = np.asarray(solution.events.time)[seen]
    t = np.concatenate([events, events, np.asarray(solution.ts)])
    order = np.argsort(t, kind="stable")
    return t[order], order


def _rows(name: str, tree: Any) -> dict[str, np.ndarray]:
    """Name of each leaf -> its rows over time, (row, entry)."""
    return {label: leaf.reshape(leaf.shape[0], -1) for label, leaf in named_leaves(name, tree).items()}


def _modes(solution: Solution) -> list[dict[str, np.ndarray]]:
    """Numbers in the mode, from the initial one on, those together that share a panel; none where it cannot be known
    or is too large to be drawn."""
    if solution.again is None:
        return []
    modes = solution.modes_after(np.arange(int(solution.events.count) + 1))
    modes = jax.tree.map(lambda part: None if _is_queue(part) else part, modes, is_leaf=_is_queue)
    drawn = {}
    for name, leaf in _rows("mode", modes).items():
        drawn |= {name if leaf.shape[1] == 1 else f"{name}[{i}]": leaf[:, i] for i in range(leaf.shape[1])[:MOST]}
    truths = {name: rows for name, rows in drawn.items() if rows.dtype == bool}
    few = {name: rows for name, rows in drawn.items() if rows.dtype != bool and np.abs(rows).max() <= FEW}
    alone = [{name: rows} for name, rows in drawn.items() if name not in truths and name not in few]
    return [together for together in (truths, few) if together] + alone


def _leaf_of(entry: str) -> str:
    """The leaf of the mode that an entry is of: "mode.on" of "mode.on[2]"."""
    return entry.partition("[")[0]


def _is_queue(part: Any) -> bool:
    """Whether it is the book-keeping of what is still to come."""
    return isinstance(part, DelayQueue)


def _draw(axes: Axes, t, values, name: str) -> None:
    shown = values[:, :MOST]
    for i in range(shown.shape[1]):
        label = f"{name}[{i}]" if shown.shape[1] > 1 else None
        axes.plot(t, shown[:, i], **line(i), linewidth=1.3, label=label)
    axes.set_ylabel(name if values.shape[1] <= MOST else f"{name}: {MOST} of {values.shape[1]}")
    legend_above(axes)


def _draw_modes(axes: Axes, solution: Solution, modes: dict[str, np.ndarray]) -> None:
    ts = np.asarray(solution.ts)
    first, last = ts[0], min(ts[-1], float(solution.end_time))  # a motion that broke off has no mode after that
    times = np.asarray(solution.events.time)[: int(solution.events.count)]
    begins = np.flatnonzero(np.append(-np.inf, times) <= first)[-1]  # which mode the motion is in at the first sample
    until = np.flatnonzero(np.append(-np.inf, times) <= last)[-1]
    t = np.concatenate([[first], times[begins:until], [last]])
    modes = {name: rows[begins : until + 1] for name, rows in modes.items()}
    if all(rows.dtype == bool for rows in modes.values()):
        return _draw_truths(axes, t, modes)
    for i, (name, rows) in enumerate(modes.items()):
        values = np.append(rows, rows[-1]).astype(float)
        axes.plot(t, values, **line(i), linewidth=1.3, drawstyle="steps-post", label=name if len(modes) > 1 else None)
    if all(rows.dtype.kind in "iu" for rows in modes.values()):
        axes.yaxis.set_major_locator(whole_ticks())
    axes.set_ylabel("mode" if len(modes) > 1 else next(iter(modes)))
    legend_above(axes)


def _draw_truths(axes: Axes, t: np.ndarray, modes: dict[str, np.ndarray]) -> None:
    """A row for each, with a bar from its time in `t` to the next one while it holds."""
    for row, holds in enumerate(modes.values()):
        spans = [(t[k], t[k + 1] - t[k]) for k in np.flatnonzero(holds)]
        axes.broken_barh(spans, (row - 0.3, 0.6), **{"facecolors": line(row)["color"]})
    names = list(modes)
    axes.set_yticks(range(len(names)), names if len(names) > 1 else [""])
    axes.set_ylabel("mode" if len(names) > 1 else names[0])
    axes.set_ylim(len(modes) - 0.4, -0.6)


def _draw_events(axes: Axes, solution: Solution) -> None:
    """A row for each number of event that happened, and of few that have names for the others too, a tick at each
    time."""
    count, names = int(solution.events.count), solution.events.names
    guard, time = np.asarray(solution.events.guard)[:count], np.asarray(solution.events.time)[:count]
    numbers = sorted(set(guard.tolist()))
    if names is not None and len(names) <= MOST_NAMES:
        numbers = list(range(len(names)))
    for row, number in enumerate(numbers):
        axes.vlines(time[guard == number], row - 0.4, row + 0.4, color="black", linewidth=0.9)
    every = max(1, -(-len(numbers) // MOST_NAMES))  # names of more rows would lie on one another
    axes.set_yticks(range(0, len(numbers), every), [solution.events.name(number) for number in numbers[::every]])
    axes.set_ylim(max(len(numbers), 1) - 0.4, -0.6)
    axes.set_ylabel("event" if count else "no event")
