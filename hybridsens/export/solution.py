"""A motion of a hybrid system as an xarray Dataset that holds all of it, and as tables for pandas."""

from typing import Any

import jax
import numpy as np

from .datasets import attributes, must_be_one, must_have_samples, of_each_run, optional
from .names import must_differ
from .trees import named_leaves, variables


def solution_dataset(solution: Any):
    """As `Solution.to_xarray`: the state over `time`, events over `event`, the final state and mode, the cost."""
    must_be_one(solution.events.count, "to_xarray()")
    xarray = optional("xarray", "to_xarray()")
    events = _happened(solution.events)
    columns = {
        **variables("final", solution.final, like="x"),
        **variables("mode", solution.mode),
        "waiting": ("guard", np.asarray(solution.waiting), {"long_name": "guards below 0 that wait until they rise"}),
        **variables("cost", solution.cost),
        "event_time": ("event", np.asarray(events.time)),
        "event_guard": ("event", np.asarray(events.guard), {"long_name": "number of the event: the guard that fell"}),
        **_named(events, "event_name"),
        **variables("event_before", events.before, "event", like="x"),
        **variables("event_after", events.after, "event", like="x"),
        **variables("event_mode", events.mode, "event", like="mode"),
    }
    coords = {}
    if solution.ts is not None:
        coords["time"] = ("time", np.asarray(solution.ts))
        columns |= variables("x", solution.x, "time")
    names = {} if solution.events.names is None else {"event_names": list(solution.events.names)}
    return xarray.Dataset(columns, coords, attributes("solution", solution) | names)


def solution_samples(solution: Any):
    """As `Solution.to_pandas`: one row for each sample, one column for each entry of the state."""
    must_be_one(solution.events.count, "to_pandas()")
    must_have_samples(solution, "solve")
    pandas = optional("pandas", "to_pandas()")
    return pandas.DataFrame(_columns("x", solution.x), pandas.Index(np.asarray(solution.ts), name="time"))


def solution_events(events: Any):
    """As `SolutionEvents.to_pandas`: one row for each event that there was."""
    if np.ndim(events.count) == 1:
        return of_each_run(events, solution_events)
    must_be_one(events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    rows = _happened(events)
    columns = {"time": np.asarray(rows.time), "guard": np.asarray(rows.guard)}
    columns |= {name: column for name, (_, column) in _named(rows, "name").items()}
    sides = (("mode", rows.mode, "after"), ("x", rows.before, "before"), ("x", rows.after, "after"))
    for root, tree, side in sides:
        columns |= {f"{name} {side}": column for name, column in _columns(root, tree).items()}
    return pandas.DataFrame(columns, pandas.RangeIndex(len(rows.time), name="event"))


def _named(events: Any, column: str) -> dict[str, tuple[str, list[str]]]:
    """A column with the name of each event; none where they have no names."""
    if events.names is None:
        return {}
    return {column: ("event", [events.name(int(number)) for number in events.guard])}


def _happened(events: Any):
    """The rows of the events that there were."""
    n = int(events.count)
    return jax.tree.map(lambda leaf: leaf[:n] if np.ndim(leaf) else leaf, events)


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
