"""Motions from files that `save` wrote."""

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .export.libraries import optional
from .export.trees import restored
from .mechanics.scene import State
from .mechanics.trajectory import Events, Trajectory
from .outcome import Steps
from .status import Status


def load(path: str | Path) -> Any:
    """What `save` wrote: a `Trajectory`, with every number as it was, or the xarray Dataset of a `FitResult`.

    The scene is not in the file, so a trajectory that was loaded has no `evaluate`.
    Raises: ImportError without xarray; FileNotFoundError; ValueError for a file that `save` did not write."""
    xarray = optional("xarray", "hybridsens.load()")
    with xarray.open_dataset(path, engine="netcdf4") as file:
        dataset = file.load()
    kind = dataset.attrs.get("hybridsens")
    if kind == "fit":
        return dataset
    if kind != "trajectory" or "cost_structure" not in dataset.attrs:
        raise ValueError(f"{path} must be a file that `save` of hybridsens wrote, but is not: open it with xarray.")
    return _trajectory(dataset)


def _trajectory(dataset) -> Trajectory:
    sampled = "time" in dataset
    array = lambda name: jnp.asarray(dataset[name].values)
    samples = (array("time"), array("q"), array("v")) if sampled else (None, None, None)
    tree = lambda name: restored(json.loads(dataset.attrs[f"{name}_structure"]), {str(n): array(n) for n in dataset})
    steps = Steps(*(jnp.asarray(dataset.attrs[f"steps_{name}"]) for name in ("accepted", "rejected")))
    final = State(array("final_q"), array("final_v"))
    events, status = _events(dataset, tree("event_mode")), _status(dataset.attrs)
    return Trajectory(*samples, final, tree("cost"), events, array("closed"), tree("mode"), status, steps)


def _events(dataset, mode) -> Events:
    """The rows of the file, with the padding that they had."""
    rows = int(dataset.attrs["max_events"])

    def filled(values, filling: Any = 0):
        return jnp.asarray(
            np.concatenate([values, np.full((rows - len(values), *values.shape[1:]), filling, values.dtype)])
        )

    def padded(name: str, filling: Any = 0):
        return filled(dataset[name].values, filling)

    before, after = (State(padded(f"event_q_{side}"), padded(f"event_v_{side}")) for side in ("before", "after"))
    return Events(
        padded("event_time", np.inf), padded("event_kind", -1), padded("event_contact", -1), before, after,
        padded("impulse"), padded("closing_speed"), padded("order_matters", False),
        jax.tree.map(lambda leaf: filled(np.asarray(leaf)), mode), jnp.asarray(dataset.sizes["event"]),
    )  # fmt: skip


def _status(attributes) -> Status:
    status: Any = jax.tree.unflatten(
        jax.tree.structure(Status.successful), [jnp.asarray(attributes["status_code"], jnp.int32)]
    )
    if (status.message or "successful") != attributes["status"]:
        raise ValueError("The file is of another version of hybridsens, in which a status has another number.")
    return status
