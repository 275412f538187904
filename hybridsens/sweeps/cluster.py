"""A sweep on many machines: one task a chunk on a `dask.distributed` client, each writing its part of one store."""

import functools
import pickle
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..configure import configure
from .engine import Engine
from .store import ZarrStore

if TYPE_CHECKING:
    from dask.distributed import Client

Tile = dict[str, slice]


def run_on_cluster(
    client: "Client",
    make_engine: Callable[[], Engine],
    location: Any,
    tasks: Iterator[tuple[Tile, dict[str, np.ndarray]]],
) -> Iterator[Tile]:
    """Run every (tile, columns) on some worker and give back the tiles as they are done.

    A worker that dies takes only its unfinished tiles with it, and they run again elsewhere; writing a tile twice
    writes the same numbers to the same place. All workers must reach the store.
    """
    try:  # an optional extra
        import cloudpickle
        from dask.distributed import as_completed
    except ImportError as error:
        raise ImportError("A sweep on a cluster needs dask.distributed: pip install 'hybridsens[cluster]'.") from error
    # As bytes, so that a worker can set JAX up before it unpickles the first array.
    program = cloudpickle.dumps(make_engine)
    x64 = bool(jax.config.read("jax_enable_x64"))
    futures = {
        client.submit(run_tile, program, x64, location, tile, columns, pure=False): tile for tile, columns in tasks
    }
    for future in as_completed(list(futures)):
        future.result()
        yield futures.pop(future)


def run_tile(program: bytes, x64: bool, location: Any, tile: Tile, columns: dict[str, np.ndarray]) -> None:
    """The task: compute one tile on this worker and write it."""
    ZarrStore(location).write(tile, _engine(program, x64).run(columns))


@functools.lru_cache(maxsize=4)
def _engine(program: bytes, x64: bool) -> Engine:
    """One engine a worker process and sweep, so that it compiles once."""
    try:
        configure(x64=x64)
    except RuntimeError:  # JAX runs already, with its own flags; the precision can still be set
        jax.config.update("jax_enable_x64", x64)
    return pickle.loads(program)()
