"""What all data sets share: libraries that only the ways out need, how motions ended, when they were sampled, the
outline from which a file is read back, and the file."""

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ..status import Status
from .one_move import in_one_move, must_have_a_folder
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
    """Attributes of a data set: what it holds, room for events."""
    return {"hybridsens": kind, "max_events": motion.events.time.shape[-1]}


def how_it_ended(motion: Any, lead: tuple[str, ...]) -> dict[str, tuple]:
    """Name -> (dimensions, array) of status, end and work, and of how many events there were."""
    numbers = {
        "end_time": motion.end_time,
        "doubt_time": motion.doubt_time,
        "steps_accepted": motion.steps.accepted,
        "steps_rejected": motion.steps.rejected,
        "event_count": motion.events.count,
    }
    names = np.array(Status.names())[np.asarray(motion.status.code)]
    return {"status": (lead, names), **{name: (lead, np.asarray(number)) for name, number in numbers.items()}}


def sample_axes(ts: Any, lead: tuple[str, ...]) -> tuple[tuple[str, ...], dict[str, tuple]]:
    """Dimensions of samples, and the coordinate of their times: (time) where all motions have the same, else (run,
    sample)."""
    ts = np.asarray(ts)
    if lead and (ts == ts[0]).all():
        ts = ts[0]
    of_times = ("time",) if ts.ndim == 1 else (*lead, "sample")
    return (*lead, of_times[-1]), {"time": (of_times, ts)}


def with_structure(dataset, **trees: Any):
    """The dataset with the outlines of trees, from which a file is read back.

    Raises: TypeError for a tree that a file cannot hold."""
    return dataset.assign_attrs(
        {f"{name}_structure": json.dumps(structure(name, tree)) for name, tree in trees.items()}
    )


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
            "so. Tables of a motion, of its events and of a fit are written by `.to_pandas().to_csv(path)`."
        )
    must_have_a_folder(path, "`path` must be that of a file")  # netCDF4 speaks of permissions
    with in_one_move(path) as draft:
        dataset.to_netcdf(draft, engine="netcdf4")
