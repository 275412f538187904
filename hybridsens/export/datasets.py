"""What all data sets share: libraries that only the ways out need, how a motion ended, the outline from which a file is
read back, and the file."""

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import jax
import jax.core
import numpy as np

from .one_move import in_one_move
from .trees import structure


def optional(library: str, wanted_by: str, extra: str = "tables") -> Any:
    """The library. Raises: ImportError that says what asked for it and which extra brings it."""
    try:
        return import_module(library)
    except ImportError as error:
        raise ImportError(
            f"{wanted_by} needs {library}, which is not installed: pip install 'hybridsens[{extra}]'."
        ) from error


def attributes(kind: str, motion: Any) -> dict[str, Any]:
    """Attributes of a data set: what it holds, status, work, room for events."""
    return {
        "hybridsens": kind,
        "status": motion.status.name,
        "end_time": float(motion.end_time),
        "doubt_time": float(motion.doubt_time),
        "steps_accepted": int(motion.steps.accepted),
        "steps_rejected": int(motion.steps.rejected),
        "max_events": motion.events.time.shape[0],
    }


def with_structure(dataset, **trees: Any):
    """The dataset with the outlines of trees, from which a file is read back.

    Raises: TypeError for a tree that a file cannot hold."""
    return dataset.assign_attrs(
        {f"{name}_structure": json.dumps(structure(name, tree)) for name, tree in trees.items()}
    )


ONE_OF_A_BATCH = "jax.tree.map(lambda leaf: leaf[i], batch)"
"""How a motion is taken out of a batch."""


def must_be_one(count, wanted_by: str) -> None:
    """Raise ValueError for a batch of motions, or one whose numbers are not known yet."""
    _must_be_known(count, wanted_by)
    if np.ndim(count) > 0:
        raise ValueError(
            f"{wanted_by} must be called on one motion, but this is a batch of {np.shape(count)}: take one of it by "
            f"{ONE_OF_A_BATCH}."
        )


def _must_be_known(count, wanted_by: str) -> None:
    if isinstance(count, jax.core.Tracer):
        raise ValueError(f"{wanted_by} must be called outside of jax.jit, jax.grad and jax.vmap, on what they return.")


def of_each_run(events: Any, table: Callable[[Any], Any]):
    """The tables of all motions in a batch below each other, with an index (run, event)."""
    _must_be_known(events.count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    on_host = jax.tree.map(np.asarray, events)
    tables = [table(jax.tree.map(lambda leaf, run=run: leaf[run], on_host)) for run in range(on_host.count.size)]
    return pandas.concat(tables, keys=range(len(tables)), names=["run", "event"])


def must_have_samples(motion: Any, made_by: str) -> None:
    """Raise ValueError for a motion without samples."""
    if motion.ts is None:
        raise ValueError(
            f"to_pandas() must have samples to tabulate, but this motion has none: pass `ts=` to `{made_by}`. Its "
            "events are a table by `.events.to_pandas()`."
        )


def write_netcdf(dataset: Any, path: str | Path) -> None:
    """Write the xarray Dataset in one move, so that a file which was there stays whole until the new one is.

    Raises: ValueError for a path with the ending of another kind of file, for a folder, or in no folder."""
    path = Path(path)
    if path.suffix not in {".nc", ""}:
        raise ValueError(
            f"`path` must end in .nc, or have no ending, since `save` writes netCDF, but is {path.name}: name it "
            "so. The tables of a motion are written by `motion.to_pandas().to_csv(path)` and "
            "`motion.events.to_pandas().to_csv(path)`."
        )
    if path.is_dir() or not path.parent.is_dir():  # netCDF4 speaks of permissions
        what = "is a folder" if path.is_dir() else "is in a folder that does not exist"
        raise ValueError(f"`path` must be that of a file in a folder that exists, but {path} {what}.")
    with in_one_move(path) as draft:
        dataset.to_netcdf(draft, engine="netcdf4")
