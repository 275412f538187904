"""Motions from files that `save` wrote."""

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .export.datasets import optional
from .export.names import names_of
from .export.trees import restored
from .mechanics.events import Events
from .mechanics.scene import State
from .mechanics.trajectory import Trajectory
from .outcome import Steps
from .solution import Solution, SolutionEvents
from .status import Status


def load(path: str | Path) -> Any:
    """What `save` wrote: a `Trajectory` or a `Solution`, or a batch of them, with every number as it was, or the xarray
    Dataset of a `FitResult`.

    A motion keeps the names of coordinates and contacts. The scene is not in the file, so a motion that was loaded has
    no `evaluate`.
    Raises: ImportError without xarray; FileNotFoundError; ValueError for a file that `save` did not write."""
    xarray = optional("xarray", "hybridsens.load()")
    try:
        with xarray.open_dataset(path, engine="netcdf4") as file:
            dataset = file.load()
    except OSError as error:
        if isinstance(error, FileNotFoundError | PermissionError):
            raise
        raise ValueError(f"{path} must be a file that `save` of hybridsens wrote, but is no netCDF file.") from error
    kind = dataset.attrs.get("hybridsens")
    if kind == "fit":
        return dataset
    readers = {"trajectory": _trajectory, "solution": _solution}
    if kind not in readers or "cost_structure" not in dataset.attrs or "status" not in dataset:
        raise ValueError(f"{path} must be a file that `save` of hybridsens wrote, but is not: open it with xarray.")
    return readers[kind](dataset)


def _trajectory(dataset) -> Trajectory:
    array = lambda name: jnp.asarray(dataset[name].values)
    samples = (_times(dataset), array("q"), array("v")) if "time" in dataset else (None, None, None)
    final = State(array("final_q"), array("final_v"))
    cost, mode, event_mode = (_tree(dataset, name, name) for name in ("cost", "scene_mode", "event_mode"))
    events, ended = _events(dataset, event_mode), _how_it_ended(dataset)
    motion = Trajectory(*samples, final, cost, events, array("closed"), *ended, mode)
    return motion.come_from(names_of(dataset), None)


def _solution(dataset) -> Solution:
    ts = _times(dataset) if "time" in dataset else None
    x = None if ts is None else _tree(dataset, "x", "x")
    rows = lambda outline, name: jax.tree.map(lambda leaf: _padded(dataset, leaf), _tree(dataset, outline, name))
    events = SolutionEvents(
        _padded(dataset, dataset["event_time"].values, np.inf), _padded(dataset, dataset["event_guard"].values, -1),
        rows("x", "event_before"), rows("x", "event_after"), rows("mode", "event_mode"),
        jnp.asarray(dataset["event_count"].values), _names(dataset.attrs),
    )  # fmt: skip
    waiting = jnp.asarray(dataset["waiting"].values)
    final, cost, mode = (_tree(dataset, *names) for names in (("x", "final"), ("cost", "cost"), ("mode", "mode")))
    return Solution(ts, x, final, cost, events, mode, *_how_it_ended(dataset), waiting, None)


def _times(dataset) -> Array:
    """Times of the samples, for each motion of a batch."""
    times = dataset["time"].values
    return jnp.asarray(np.broadcast_to(times, (*dataset["status"].shape, times.shape[-1])))


def _names(attributes) -> tuple[str, ...] | None:
    """The names of events. A netCDF file gives a list of one text back as that text."""
    given = attributes.get("event_names")
    return None if given is None else tuple(np.atleast_1d(given).tolist())


def _tree(dataset, outline: str, name: str) -> Any:
    """The tree whose leaves are the variables `name`, `name`.this, ..., in the structure that is kept as `outline`."""
    leaves = [str(key) for key in dataset if key == name or str(key).startswith(f"{name}.")]
    arrays = {outline + key.removeprefix(name): jnp.asarray(dataset[key].values) for key in leaves}
    return restored(json.loads(dataset.attrs[f"{outline}_structure"]), arrays)


def _events(dataset, mode) -> Events:
    """The rows of the file, with the padding that they had."""
    padded = lambda name, filling=0.0: _padded(dataset, dataset[name].values, filling)
    before, after = (State(padded(f"event_q_{side}"), padded(f"event_v_{side}")) for side in ("before", "after"))
    return Events(
        padded("event_time", np.inf), padded("event_kind", -1), padded("event_contact", -1), before, after,
        padded("impulse"), padded("closing_speed"), padded("order_matters", False),
        jnp.asarray(dataset["event_count"].values), jax.tree.map(lambda leaf: _padded(dataset, leaf), mode),
    )  # fmt: skip


def _padded(dataset, rows, filling: float | int = 0):
    """The rows of events with the room that there was for more; in a batch each motion has its own."""
    rows, axis = np.asarray(rows), dataset["status"].ndim
    room = int(dataset.attrs["max_events"]) - rows.shape[axis]
    blank = np.full((*rows.shape[:axis], room, *rows.shape[axis + 1 :]), filling, rows.dtype)
    return jnp.asarray(np.concatenate([rows, blank], axis))


def _how_it_ended(dataset) -> tuple[Status, Array, Array, Steps]:
    array = lambda name: jnp.asarray(dataset[name].values)
    steps = Steps(array("steps_accepted"), array("steps_rejected"))
    return _status(dataset["status"].values), array("end_time"), array("doubt_time"), steps


def _status(names: np.ndarray) -> Status:
    known = Status.names()
    if unknown := sorted(set(np.ravel(names).tolist()) - set(known)):
        raise ValueError(f"The file is of another version of hybridsens, which has a status {unknown[0]!r}.")
    codes = np.array([known.index(name) for name in np.ravel(names)], np.int32)
    return Status(jnp.asarray(codes.reshape(names.shape)))
