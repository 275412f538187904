"""Motions of a hybrid system as an xarray Dataset that holds all of them, and as tables for pandas."""

from typing import Any

import jax
import numpy as np

from ..delays import DelayQueue
from .batches import happened, leading, must_be_known, of_each_run
from .datasets import attributes, how_it_ended, must_have_samples, optional, sample_axes
from .names import must_differ
from .trees import named_leaves, variables


def solution_dataset(solution: Any):
    """As `Solution.to_xarray`: the state over `time`, events over `event`, the final state and mode, the cost."""
    lead = leading(solution.events.count, "to_xarray()")
    xarray = optional("xarray", "to_xarray()")
    events, row = happened(solution.events), (*lead, "event")
    columns = {
        **variables("final", solution.final, *lead, like="x"),
        **variables("mode", solution.mode, *lead),
        "waiting": (
            (*lead, "guard"), np.asarray(solution.waiting), {"long_name": "guards below 0 that wait until they rise"},
        ),
        **how_it_ended(solution, lead),
        **variables("cost", solution.cost, *lead),
        "event_time": (row, events.time),
        "event_guard": (row, events.guard, {"long_name": "number of the event: the guard that fell"}),
        **_named(events, "event_name", row),
        **variables("event_before", events.before, *row, like="x"),
        **variables("event_after", events.after, *row, like="x"),
        **variables("event_mode", events.mode, *row, like="mode"),
    }  # fmt: skip
    coords = {}
    if solution.ts is not None:
        axes, coords = sample_axes(solution.ts, lead)
        columns |= variables("x", solution.x, *axes)
    names = {} if solution.events.names is None else {"event_names": list(solution.events.names)}
    return xarray.Dataset(columns, coords, attributes("solution", solution) | names)


def solution_samples(solution: Any):
    """As `Solution.to_pandas`: one row for each sample, one column for each entry of the state and of the mode."""
    must_have_samples(solution, "solve")
    if np.ndim(solution.events.count) > 0:
        return of_each_run(solution, solution.events.count, solution_samples)
    must_be_known(solution.events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    columns = _columns("x", solution.x) | _columns("mode", _with_counts(_sampled_modes(solution)))
    return pandas.DataFrame(columns, pandas.Index(np.asarray(solution.ts), name="time"))


def _sampled_modes(solution: Any) -> Any:
    """The mode at each sample; None where there is none, or a loaded motion does not know the first one."""
    if solution.again is None:
        return None
    times = happened(solution.events).time
    return solution.modes_after(np.searchsorted(times, np.asarray(solution.ts), side="right"))


def solution_events(events: Any):
    """As `SolutionEvents.to_pandas`: one row for each event that there was."""
    if np.ndim(events.count) > 0:
        return of_each_run(events, events.count, solution_events)
    must_be_known(events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    rows = happened(events)
    columns = {"time": rows.time, "guard": rows.guard}
    columns |= {name: column for name, (_, column) in _named(rows, "name").items()}
    sides = (("mode", _with_counts(rows.mode), "after"), ("x", rows.before, "before"), ("x", rows.after, "after"))
    for root, tree, side in sides:
        columns |= {f"{name} {side}": column for name, column in _columns(root, tree).items()}
    return pandas.DataFrame(columns, pandas.RangeIndex(len(rows.time), name="event"))


def _with_counts(modes: Any) -> Any:
    """Modes with how many events wait in place of each queue: its places would be most of a table's columns."""
    is_queue = lambda part: isinstance(part, DelayQueue)
    return jax.tree.map(lambda part: part.taken.sum(axis=-1) if is_queue(part) else part, modes, is_leaf=is_queue)


def _named(events: Any, column: str, row: tuple[str, ...] = ("event",)) -> dict[str, tuple]:
    """A column with the name of each event, "" in padding; none where they have no names."""
    if events.names is None:
        return {}
    return {column: (row, np.array([*events.names, ""])[events.guard])}  # the -1 of padding is the last, ""


def _columns(root: str, tree: Any) -> dict[str, np.ndarray]:
    """Name of each entry -> its column: v, v[1], i[0, 2], or x[1] where the state has no names of its own; mode.on. The
    first axis of each leaf is that of the rows."""
    columns = []
    for name, leaf in named_leaves(root, tree).items():
        label = name.removeprefix("x.")
        for index in np.ndindex(*leaf.shape[1:]):
            columns.append((f"{label}[{', '.join(map(str, index))}]" if index else label, leaf[:, *index]))
    must_differ([name for name, _ in columns], "Entries of a state or a mode", "the system")
    return dict(columns)
