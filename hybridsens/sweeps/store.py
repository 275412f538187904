"""Where results go, chunk by chunk: arrays in memory, or a Zarr store that survives being killed.

The points are cut into rectangular tiles, each computed, stored and resumed as a whole: one chunk of every array. Its
arrays are written one after the other and `status` last, each file in one move, so a tile is complete exactly if its
status is there; any other tile is computed again and overwritten.
"""

import contextlib
import itertools
import math
import os
import tempfile
import threading
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..export.datasets import optional
from .dataset import Variable
from .point import NOT_COMPUTED


def tile_shape(shape: dict[str, int], points: int) -> dict[str, int]:
    """Edge lengths of tiles with at most `points` points each.

    The last dimensions stay whole as long as they fit, one dimension is cut in pieces of nearly equal length (so that
    little of the last one is padding), and those before it are taken one index at a time.
    """
    edges, room = {}, points
    for name, size in reversed(shape.items()):
        edge = min(size, max(room, 1))
        edges[name] = math.ceil(size / math.ceil(size / edge))
        room //= size
    return {name: edges[name] for name in shape}


def tiles(shape: dict[str, int], edges: dict[str, int]) -> list[dict[str, slice]]:
    """All tiles, in the order of the points: slices by the name of the dimension."""
    cuts = [
        [(name, slice(start, min(start + edges[name], size))) for start in range(0, size, edges[name])]
        for name, size in shape.items()
    ]
    return [dict(tile) for tile in itertools.product(*cuts)]


def points_in(tile: dict[str, slice]) -> int:
    """Number of points in a tile."""
    return math.prod(cut.stop - cut.start for cut in tile.values())


_MARK = "hybridsens_sweep"
_READY = "ready"
_WRITING = threading.Lock()
"""Zarr's settings are those of the whole process, and workers of a cluster may be its threads."""


class MemoryStore:
    """All results in memory."""

    def __init__(self, layout: Mapping[str, Variable]):
        self.arrays = {name: np.full(v.shape, v.fill, v.dtype) for name, v in layout.items()}

    def write(self, tile: Mapping[str, slice], results: Mapping[str, np.ndarray]) -> None:
        """Put the results of a tile in their places."""
        write_tile(self.arrays, tile, results)

    def has(self, tile: Mapping[str, slice]) -> bool:
        """Nothing is there before the first run."""
        del tile
        return False


class ZarrStore:
    """Results on disk (or wherever Zarr writes to)."""

    def __init__(self, location: Any):
        self.location = location
        self.arrays: Any = _zarr().open_group(location, mode="r+")

    def write(self, tile: Mapping[str, slice], results: Mapping[str, np.ndarray]) -> None:
        """Put the results of a tile in their chunks, of which none is left out, empty or not."""
        with _WRITING, _zarr().config.set({"array.write_empty_chunks": True}):
            write_tile(self.arrays, tile, results)

    def has(self, tile: Mapping[str, slice]) -> bool:
        """Whether a tile is complete."""
        first = tuple(cut.start for cut in tile.values())
        with _intact(self.location):
            return int(self.arrays["status"][first]) != NOT_COMPUTED


def write_tile(arrays, tile: Mapping[str, slice], results: Mapping[str, np.ndarray]) -> None:
    """Write results (point, ...) of one tile, `status` last."""
    where = tuple(tile.values())
    lengths = [cut.stop - cut.start for cut in where]
    for name in (*(name for name in results if name != "status"), "status"):
        values = results[name]
        arrays[name][where] = values.reshape(*lengths, *values.shape[1:])


def open_or_create(
    location: Any,
    digest: str,
    layout: Mapping[str, Variable],
    coordinates: Mapping[str, tuple],
    edges: Mapping[str, int],
    attributes: dict,
) -> ZarrStore:
    """The store of a sweep, new or to be resumed.

    Raises ValueError if there is something else, the store of another sweep, or a store that cannot be read.
    """
    found = _state(location)
    if found is None or found == {"digest": digest}:  # nothing, or killed while it was made
        _create_at_once(location, lambda place: _create(place, digest, layout, coordinates, edges, attributes))
        found = _state(location)  # another sweep may have been quicker
    if found != {"digest": digest, "state": _READY}:
        raise ValueError(
            f"`store` must be a new place or the store of this very sweep, but {location} belongs to something else: "
            "other points, another cost, other settings or another version of JAX. Choose another place or remove it."
        )
    store = ZarrStore(location)
    with _intact(location):
        _check_chunks(store.arrays, layout)
    return store


def _check_chunks(arrays, layout: Mapping[str, Variable]) -> None:
    """A finished tile has a chunk in every array, also where that holds nothing but nan (see `write`): one that is lost
    would be read as such."""
    finished = arrays["status"].nchunks_initialized  # first, for another process may be at work
    expected = lambda array: min(finished, array.nchunks)  # an array without entries has none
    damaged = [name for name in layout if arrays[name].nchunks_initialized < expected(arrays[name])]
    if damaged:
        raise ValueError(f"chunks of {', '.join(damaged)} are lost")


def _create_at_once(location, create) -> None:
    """Where the store is a folder it is made beside its place and moved there whole: of two processes that begin
    together the second finds the store of the first."""
    is_path = isinstance(location, str | Path) and "://" not in str(location)
    path = Path(location) if is_path else Path()
    if not is_path or (path.is_dir() and any(path.iterdir())):
        create(location)
        return
    with _folder_beside(path) as beside:
        create(Path(beside) / path.name)
        try:
            os.replace(Path(beside) / path.name, path)
        except OSError:
            if not path.exists():  # else that of the other process
                raise


def _folder_beside(path: Path) -> tempfile.TemporaryDirectory:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise OSError(
            f"`store` must be in a folder that can be written to, but {path} is not ({error.strerror}): name another "
            "one."
        ) from error


def _state(location) -> dict | None:
    """What a store says about itself: None if nothing is there, {} if it is not a sweep's."""
    zarr = _zarr()
    if isinstance(location, str | Path) and Path(location).is_dir() and not any(Path(location).iterdir()):
        return None
    try:
        with _intact(location):
            mark = zarr.open_group(location, mode="r").attrs.get(_MARK)
        return mark if isinstance(mark, dict) else {}
    except FileNotFoundError:
        if isinstance(location, str | Path) and Path(location).exists():
            return {}
        return None
    except zarr.errors.ContainsArrayError:
        return {}


@contextlib.contextmanager
def _intact(location):
    """Files of a store that hold no JSON, or no chunk, are an error that says so, and not one of their reader."""
    try:
        yield
    except (FileNotFoundError, _zarr().errors.BaseZarrError):
        raise
    except (ValueError, TypeError, KeyError, RuntimeError) as error:
        raise ValueError(
            f"`store` must be a new place or the intact store of this sweep, but {location} cannot be read: {error}. "
            "Remove it, and the sweep starts anew; choose another place; or put a copy back."
        ) from error


def _create(location, digest, layout, coordinates, edges, attributes):
    group = _zarr().open_group(location, mode="w", attributes={_MARK: {"digest": digest}})
    for name, (dims, values, about) in coordinates.items():
        array = group.create_array(
            name, shape=values.shape, dtype=values.dtype, chunks=values.shape, dimension_names=dims, attributes=about
        )
        array[...] = values
    for name, variable in layout.items():
        chunks = tuple(edges.get(dim, size) for dim, size in zip(variable.dims, variable.shape, strict=True))
        group.create_array(
            name, shape=variable.shape, dtype=variable.dtype, chunks=tuple(max(1, n) for n in chunks),
            dimension_names=variable.dims, fill_value=variable.fill, attributes=variable.attributes,
        )  # fmt: skip
    with warnings.catch_warnings():  # Zarr's word that not every reader of format 3 knows of consolidated metadata
        warnings.simplefilter("ignore")
        group = _zarr().consolidate_metadata(group.store)
    # By this attribute xarray knows coordinates that are no dimension.
    group.attrs.update(attributes | {"coordinates": " ".join(coordinates), _MARK: {"digest": digest, "state": _READY}})


def _zarr() -> Any:
    return optional("zarr", "A store", "sweep")
