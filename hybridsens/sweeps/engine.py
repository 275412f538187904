"""Many points at once: sharded over the devices of a machine, mapped or vmapped on each, in one compiled program; and
the digest of that program, by which a store knows it again."""

import functools
import hashlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from ..outcome import SimulationError
from ..validation.caller import warn_caller
from ..validation.program import array_bytes
from .point import Wanted, evaluate

BATCH_AXIS = "batch"
ROOMS = tuple(4**power for power in range(3, 16))
"""Numbers of points that mapped batches have room for, so that most other numbers find their program compiled."""

# One point as a program of its own: shapes, fingerprint and batches share what was traced, in this sweep and the next.
evaluate_once = eqx.filter_jit(evaluate)


class Program(NamedTuple):
    """What is run at every point."""

    cost: Callable
    scene: Any
    """What all points share."""
    wanted: Wanted


class Engine:
    """Runs batches of points. `run` takes columns (point, ...) and returns results (point, ...), both as NumPy arrays.

    On a CPU each device runs its points one after the other, so that no point waits for another, and room that is left
    costs nothing; elsewhere all points of a device run in step (`jax.vmap`). A batch that does not fit into memory is
    halved, with a warning, and stays halved.
    """

    def __init__(self, program: Program, batch: int, devices: Sequence[Any] | None, mapped: bool | None):
        devices = list(jax.devices() if devices is None else devices)
        self.program = program
        self.mesh = Mesh(np.array(devices), (BATCH_AXIS,))
        self.mapped = devices[0].platform == "cpu" if mapped is None else mapped
        room = next((room for room in ROOMS if room >= batch), batch) if self.mapped else batch
        self.batch = _multiple(room, len(devices))

    def run(self, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """All points, in as many batches as memory needs."""
        size, parts, start = len(next(iter(columns.values()))), [], 0
        while start < size:
            batch = self.batch if self.mapped else min(self.batch, _multiple(size, self.mesh.size))
            stop = min(start + batch, size)
            try:
                parts.append(self._run_batch({name: column[start:stop] for name, column in columns.items()}, batch))
            except (jax.errors.JaxRuntimeError, MemoryError) as error:
                self._halve(error, batch)
            else:
                start = stop
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _run_batch(self, columns, batch):
        given = len(next(iter(columns.values())))
        count = _multiple(given, self.mesh.size) // self.mesh.size  # on each device
        order = self._order(batch)
        rows = np.minimum(order, given - 1)  # a batch is filled up with its last point, so that its shape never changes
        sharding = NamedSharding(self.mesh, PartitionSpec(BATCH_AXIS))
        sharded = {name: jax.device_put(column[rows], sharding) for name, column in columns.items()}
        results = _run(self.program, sharded, jnp.asarray(count), self.mesh, self.mapped)
        back = np.argsort(order)[:given]
        return {name: np.asarray(result)[back] for name, result in jax.block_until_ready(results).items()}

    def _order(self, batch):
        """Mapped points are dealt out like cards: devices get equal work where it varies smoothly over the points.

        Points that run in step stay beside their neighbours, which take about as long as they do."""
        order = np.arange(batch)
        return order.reshape(-1, self.mesh.size).T.ravel() if self.mapped else order

    def _halve(self, error, batch):
        if isinstance(error, jax.errors.JaxRuntimeError) and "RESOURCE_EXHAUSTED" not in str(error):
            _, raised, told = str(error).partition(f"{SimulationError.__name__}: ")
            if raised:  # JAX makes its own error of what a compiled program raises
                raise SimulationError(
                    "A point of a sweep must fail by itself, but one ended the sweep: write simulate(..., throw=False) "
                    f"or solve(..., throw=False) in the cost. {told}"
                ) from error
            raise error
        if batch <= self.mesh.size:
            raise MemoryError(
                "One point on each device does not fit into memory: lower `max_steps`, `max_events`."
            ) from error
        self.batch = _multiple(batch // 2, self.mesh.size)
        warn_caller(
            f"{batch} points at once do not fit into memory; going on with {self.batch}. "
            "A smaller `chunk`, `max_steps` or `max_events` avoids the attempt."
        )


@eqx.filter_jit
def _run(program: Program, columns, count, mesh: Mesh, mapped: bool):
    arrays, static = eqx.partition(program, eqx.is_array)

    def shard(arrays, count, columns):
        point = functools.partial(evaluate_once, *eqx.combine(arrays, static))
        return _one_by_one(point, columns, count) if mapped else jax.vmap(point)(columns)

    everywhere, by_point = PartitionSpec(), PartitionSpec(BATCH_AXIS)
    # Without following what varies over the mesh: Diffrax's loops begin with constants, which vary over nothing.
    given = everywhere, everywhere, by_point
    sharded = jax.shard_map(shard, mesh=mesh, in_specs=given, out_specs=by_point, check_vma=False)
    return sharded(arrays, count, columns)


def _one_by_one(point, columns, count):
    """The results of the first `count` points, and zeros for the others, which are not run."""
    row = lambda k: jax.tree.map(lambda column: column[k], columns)
    room = jax.tree.leaves(columns)[0].shape[0]
    blank = jax.tree.map(lambda s: jnp.zeros((room, *s.shape), s.dtype), jax.eval_shape(point, row(0)))
    write = lambda k, rows: jax.tree.map(lambda of, new: of.at[k].set(new), rows, point(row(k)))
    return lax.fori_loop(0, count, write, blank)


def shapes(program: Program, columns: dict[str, np.ndarray]) -> dict[str, jax.ShapeDtypeStruct]:
    """Names, shapes and types of what one point gives."""
    one = {name: jnp.asarray(column[0]) for name, column in columns.items()}
    return eqx.filter_eval_shape(evaluate_once, program.cost, program.scene, program.wanted, one)


def _multiple(size: int, of: int) -> int:
    return max(1, -(-size // of)) * of


def program_digest(program: Program, columns: dict[str, np.ndarray]) -> str:
    """A digest of the program of one point as the compiler gets it: the same digest means the same numbers.

    Its text alone is not enough. Arrays of the scene and of the cost are arguments of the program, and so are arrays
    that the cost closes over with `jax_use_simplified_jaxpr_constants`: the text has their shapes only.
    """
    one = {name: jnp.asarray(column[0]) for name, column in columns.items()}
    given = (program.cost, program.scene, program.wanted, one)
    digest = hashlib.sha256(evaluate_once.lower(*given).as_text().encode())
    traced, _, _ = eqx.filter_make_jaxpr(evaluate_once)(*given)
    arguments = filter(_is_array, jax.tree.leaves((program.cost, program.scene)))
    # Each array once, in the order of use: programs differ that hold the same data in other places.
    for array in {id(array): array for array in (*arguments, *_constants(traced))}.values():
        digest.update(array_bytes(array))
    return digest.hexdigest()


def _constants(jaxpr: ClosedJaxpr | Jaxpr) -> Iterator[Any]:
    """All arrays that a traced function holds, in the order of the trace; scalars stand in the text."""
    if isinstance(jaxpr, ClosedJaxpr):
        yield from jaxpr.consts
        jaxpr = jaxpr.jaxpr
    for equation in jaxpr.eqns:
        yield from _literals(equation.invars)
        for inner in jax.tree.leaves(equation.params):
            if isinstance(inner, ClosedJaxpr | Jaxpr):
                yield from _constants(inner)
    yield from _literals(jaxpr.outvars)


def _literals(atoms) -> Iterator[Any]:
    return (atom.val for atom in atoms if isinstance(atom, Literal) and np.ndim(atom.val) > 0)


def _is_array(leaf: Any) -> bool:
    return eqx.is_array(leaf) or isinstance(leaf, np.ndarray | np.generic)
