"""The entry point of sweeps: points in, a Dataset of values, gradients, events and statuses out."""

import functools
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from ..outcome import noting_motions_not_raised
from ..parameters import parameters
from ..validation.arguments import whole_number
from ..validation.asked import kind_of
from ..validation.caller import warn_caller
from ..validation.spelling import did_you_mean
from .cluster import run_on_cluster
from .dataset import coordinates, from_memory, from_store, variables, xarray
from .designs import Count, Design, batch
from .engine import Engine, Program, program_digest, shapes
from .point import Wanted
from .progress import print_statuses, progress_bar
from .store import MemoryStore, ZarrStore, open_or_create, points_in, tile_shape, tiles

if TYPE_CHECKING:
    import xarray as xr

OTHER_FILES = (".csv", ".nc", ".json", ".txt", ".h5", ".parquet")
"""Endings of what is no Zarr store. It would be made as a folder of that name."""
MOST_FIXED = 100
"""Numbers of a parameter that is not varied which a Dataset lists."""


def sweep(
    cost: Callable,
    scenes: Any,
    *,
    gradient: bool | str | Sequence[str] = True,
    events: Count = 8,
    states: bool = False,
    store: Any = None,
    chunk: Count = 8192,
    devices: Sequence[Any] | None = None,
    mapped: bool | None = None,
    client: Any = None,
    units: Mapping[str, str] | None = None,
    about: Mapping[str, Any] | None = None,
    progress: bool = True,
) -> "xr.Dataset":
    """Value J and gradient dJ/d(parameter) at many points, on all devices of the machine, with status and events.

    A point that fails is marked in `status` and has NaN as J and gradient; it does not stop the others. (Of a motion
    with `throw=False` that the cost does not return nothing is known: a warning says so.) At a grazing
    point the gradient alone is NaN.

    Arguments:

    - `cost`: `cost(scene)`, which returns J, or (J, trajectory): then the Dataset tells of each point's status and
      events too. Simulate with `throw=False`, and with `max_steps` and `max_events` not much above what is needed.
    - `scenes`: a design (`grid`, `sobol`, ...), or a PyTree of scenes whose array leaves all have one leading axis.
    - `gradient`: all parameters (True), none (False), a name or several. Reverse mode: all cost little more than one.
    - `events`: how many of the first events of each point are written down one by one.
    - `states`: keep q and v at the trajectory's `ts`.
    - `store`: where to stream results to, chunk by chunk, as a Zarr store. A sweep that was killed goes on where it was
      when called again with the same store: points, cost, settings and all arrays that the cost holds must be the same.
      What a `jax.pure_callback` reads is not seen: choose another store where that changes. Without a store, results
      are held in memory.
    - `chunk`: points run and written at once.
    - `devices`: all of `jax.devices()` by default. `hybridsens.configure(host_devices=8)` shows a CPU as 8 devices.
    - `mapped`: run a device's points one after the other (default on a CPU) or in step (default elsewhere).
    - `client`: a `dask.distributed` client; needs a `store` that all workers reach.
    - `units`: units by the name of a parameter or result, for the attributes of the Dataset.
    - `about`: what else the Dataset should tell in its attributes, such as the horizon and the tolerance of the cost.
    - `progress`: show a bar, and a table of statuses at the end. Ctrl-C ends the sweep and keeps the chunks that are
      finished; the attribute `interrupted` says so.

    Returns: an xarray Dataset with the design's dimensions: J, dJ_d<name>, status, and with a trajectory event_count,
    event_sequence (equal numbers: the same sequence), grazing_margin [m/s], steps, event_time [s], event_kind,
    event_contact. Its attributes are the kind of design, which parameters it varies, the class of the scene, and its
    parameters that are the same at all points, as JSON (`fixed`).

    Raises: ValueError or TypeError for a cost, names, units or a store that do not fit.
    """
    if not callable(cost):
        raise TypeError(f"`cost` must be a function of (scene), and come before the scenes, but is {kind_of(cost)}.")
    xarray()  # if it is missing, it is told before anything has been computed
    design = scenes if isinstance(scenes, Design) else batch(scenes)
    chunk, events = whole_number("`chunk`", chunk), whole_number("`events`", events, 0)
    if isinstance(store, str | Path) and Path(store).suffix in OTHER_FILES:
        raise ValueError(f"`store` must be a Zarr store, a folder such as map.zarr, but is {str(store)!r}.")
    if client is not None and store is None:
        raise ValueError("A sweep on a cluster must have a `store` that all workers can write to, but has none.")
    wanted = Wanted(_gradient_names(design.scene, gradient), events, states)
    program = Program(cost, design.scene, wanted)
    first = design.block({name: slice(0, 1) for name in design.shape})
    units = dict(units or {})
    with noting_motions_not_raised() as not_raised:
        point = shapes(program, first)
    if not_raised and "steps" not in point:
        warn_caller(
            "The cost returns J alone, of a motion with `throw=False`: a point whose motion broke off would count as "
            "successful, with the J of where it did. Return (J, motion), or simulate with `throw=\"nan\"`."
        )
    layout, coords = variables(design, point, units), coordinates(design, units)
    edges = tile_shape(design.shape, chunk)
    attributes = dict(about or {}) | _about(design)
    if store is None:
        target = MemoryStore(layout)
    else:
        target = open_or_create(store, _digest(design, program, first, edges), layout, coords, edges, attributes)
    make_engine = functools.partial(Engine, program, points_in(tiles(edges, edges)[0]), devices, mapped)
    interrupted = False
    try:
        _run_all(design, edges, target, make_engine, client, progress)
    except KeyboardInterrupt:
        interrupted = True
    if isinstance(target, ZarrStore):
        dataset = from_store(store, layout, coords, attributes)
    else:
        dataset = from_memory(target.arrays, layout, coords, attributes)
    if interrupted:
        dataset.attrs["interrupted"] = "by Ctrl-C: the points that were not reached have no values"
    if progress:
        print_statuses(dataset)
    return dataset


def _run_all(design: Design, edges, target, make_engine, client, progress: bool) -> None:
    """Every tile that is not there yet, here or on a cluster."""
    missing = [tile for tile in tiles(design.shape, edges) if not target.has(tile)]
    left = sum(points_in(tile) for tile in missing)
    with progress_bar(design.size, design.size - left, progress) as advance:
        if client is not None:
            tasks = ((tile, design.block(tile)) for tile in missing)
            for tile in run_on_cluster(client, make_engine, target.location, tasks):
                advance(points_in(tile))
            return
        engine = make_engine()
        for tile in missing:
            _write_whole(target, tile, engine.run(design.block(tile)))
            advance(points_in(tile))


def _write_whole(target, tile, results) -> None:
    """Write a tile, also where Ctrl-C comes in the middle: half of one would have values without a status."""
    try:
        target.write(tile, results)
    except KeyboardInterrupt:
        target.write(tile, results)
        raise


def _about(design: Design) -> dict[str, str]:
    """What a file says of its points: of what they are, and what is the same in all of them."""
    array = lambda value: not isinstance(value, jax.ShapeDtypeStruct) and np.size(value) <= MOST_FIXED
    others = {name: value for name, value in parameters(design.scene).items() if name not in design.columns}
    fixed = {name: np.asarray(value).tolist() for name, value in others.items() if array(value)}
    # A store lists its coordinates by the alphabet. As JSON, since netCDF has no lists of texts.
    varied, model = json.dumps(list(design.columns)), type(design.scene).__name__
    return {"design": design.kind, "varied": varied, "model": model, "fixed": json.dumps(fixed)}


def _digest(design: Design, program: Program, first, edges) -> str:
    """What a store must agree on to be resumed: points, chunks, and the program of a point with its data."""
    text = f"{design.fingerprint()} {edges} {program_digest(program, first)}"
    return hashlib.sha256(text.encode()).hexdigest()


def _gradient_names(scene, gradient) -> tuple[str, ...]:
    known = tuple(parameters(scene))
    if isinstance(gradient, bool):
        return known if gradient else ()
    gradient = (gradient,) if isinstance(gradient, str) else tuple(gradient)
    unknown = [name for name in gradient if name not in known]
    if unknown:
        raise ValueError(
            f"`gradient` must have names among {', '.join(known)}, but has {', '.join(unknown)}."
            f"{did_you_mean(unknown, known)}"
        )
    return gradient
