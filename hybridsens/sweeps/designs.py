"""Which points a sweep visits: grids, random and quasi-random designs over named parameters, or scenes as given."""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from ..parameters import check_names, parameters
from ..validation.arguments import whole_number

Bounds = Mapping[str, tuple[float, float]]
"""Lowest and highest value of each parameter."""
Count = int | np.integer


@dataclasses.dataclass(frozen=True, repr=False)
class Design:
    """Points in parameter space, held by column: a grid stores its axes only, however many points it has."""

    scene: Any
    """What every point shares; the columns replace some of its leaves."""
    shape: dict[str, int]
    """Name and length of each dimension of the points."""
    columns: dict[str, np.ndarray]
    """Values of each varied parameter; the leading axes are `dims[name]`."""
    dims: dict[str, tuple[str, ...]]
    """Along which dimensions a column varies."""
    kind: str
    """How the points were chosen."""
    bounds: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    """Box that the points were drawn from, where there is one."""

    @property
    def size(self) -> int:
        """Number of points."""
        return int(np.prod(list(self.shape.values())))

    def __repr__(self) -> str:
        shape = " x ".join(map(str, self.shape.values()))
        ends = {name: (float(column.min()), float(column.max())) for name, column in self.columns.items()}
        ranges = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in ends.items())
        return f"Design({self.kind}, {shape} points of {type(self.scene).__name__}: {ranges})"

    def block(self, slices: Mapping[str, slice]) -> dict[str, np.ndarray]:
        """Columns of a block of points, one row a point, in the order of the dimensions."""
        lengths = [len(range(*slices[dim].indices(size))) for dim, size in self.shape.items()]
        return {name: self._rows(name, slices, lengths) for name in self.columns}

    def _rows(self, name, slices, lengths):
        values = self.columns[name][tuple(slices[dim] for dim in self.dims[name])]
        entry = values.shape[len(self.dims[name]) :]
        along = [n if dim in self.dims[name] else 1 for dim, n in zip(self.shape, lengths, strict=True)]
        spread = np.broadcast_to(values.reshape(*along, *entry), (*lengths, *entry))
        return spread.reshape(-1, *entry)

    def fingerprint(self) -> str:
        """A digest of all that decides the points, so that a store can tell whether it belongs to them."""
        digest = hashlib.sha256(repr((self.kind, self.shape, self.dims, self.bounds)).encode())
        for name, leaf in (*parameters(self.scene).items(), *self.columns.items()):
            digest.update(name.encode() + np.ascontiguousarray(leaf).tobytes())
        return digest.hexdigest()


def grid(scene: Any, values: Mapping[str, Sequence[float] | np.ndarray | jax.Array]) -> Design:
    """All combinations of the given values: `grid(scene, {"amplitude": linspace(0.5, 1.5, 50), ...})`.

    Each parameter is a dimension of the result. Raises ValueError for an unknown name or a bad list of values.
    """
    if not isinstance(values, Mapping):
        raise TypeError(
            "`values` must be a mapping of parameters to lists of numbers, grid(scene, {\"mass\": [1.0, 2.0]}), but is "
            f"{type(values).__name__}."
        )
    check_names(scene, values)
    complex_ones = [name for name, axis in values.items() if np.iscomplexobj(axis)]
    if complex_ones:
        raise ValueError(f"The values of {complex_ones[0]!r} must be real numbers, but are complex.")
    for name, axis in values.items():
        if isinstance(axis, tuple) and len(axis) == 3 and isinstance(axis[2], int) and not isinstance(axis[0], int):
            low, high, count = axis
            raise ValueError(
                f"The values of {name!r} must be listed, but are {axis}, which looks like {count} of them between two "
                f"ends. Write jnp.linspace({low}, {high}, {count}), or [{low}, {high}, {count}] for these three."
            )
    axes = {name: np.asarray(axis, float) for name, axis in values.items()}
    for name, axis in axes.items():
        if axis.ndim != 1 or axis.size == 0 or not np.isfinite(axis).all():
            raise ValueError(
                f"The values of {name!r} must be a list of finite numbers, but have shape {axis.shape}: {axis}."
            )
    if not axes:
        raise ValueError("A grid must have at least one parameter to vary, but has none.")
    return Design(
        scene, {name: axis.size for name, axis in axes.items()}, axes, {name: (name,) for name in axes}, "grid"
    )


def random(scene: Any, bounds: Bounds, points: Count, seed: int = 0) -> Design:
    """Independent uniform points in a box. Raises ValueError for an unknown name or bad bounds."""
    count = _size_of_box(scene, bounds)
    return _table(scene, bounds, np.random.default_rng(seed).random((_positive(points), count)), "random")


def latin_hypercube(scene: Any, bounds: Bounds, points: Count, seed: int = 0) -> Design:
    """Points of which each parameter takes one value in each of `points` equal intervals (scipy's `LatinHypercube`)."""
    sampler = qmc.LatinHypercube(_size_of_box(scene, bounds), rng=np.random.default_rng(seed))
    return _table(scene, bounds, sampler.random(_positive(points)), "latin_hypercube")


def sobol(scene: Any, bounds: Bounds, points: Count, seed: int = 0) -> Design:
    """A scrambled Sobol sequence, for averages. `points` must be a power of two, which keeps it balanced."""
    return _table(scene, bounds, _sobol_points(_size_of_box(scene, bounds), points, seed), "sobol")


def saltelli(scene: Any, bounds: Bounds, base: Count, seed: int = 0) -> Design:
    """Points for Sobol indices: A, B, and A with one column from B after the other; base (parameters + 2) in all.

    `base` must be a power of two. `sobol_indices` reads the result of the sweep. (Saltelli et al. 2010, table 2.)
    """
    count = _size_of_box(scene, bounds)
    both = _sobol_points(2 * count, base, seed)
    a, b = both[:, :count], both[:, count:]
    mixed = [np.where(np.arange(count) == i, b, a) for i in range(count)]
    return _table(scene, bounds, np.concatenate([a, b, *mixed]), "saltelli")


def batch(scenes: Any) -> Design:
    """Scenes as they are: one PyTree whose array leaves, integers and booleans too, all have the same leading axis.

    Raises ValueError if the leading axes differ, if there is no parameter at all, or for arrays of no numbers.
    """
    leaves = _named_arrays(scenes)
    lengths = {name: leaf.shape[0] if leaf.ndim > 0 else 0 for name, leaf in leaves.items()}
    if not parameters(scenes) or len(set(lengths.values())) != 1 or 0 in lengths.values():
        stack = "`jax.tree.map(lambda *leaves: jnp.stack(leaves), *scenes)` makes one of several. "
        raise ValueError(
            "Scenes must come as one whose arrays all have the same leading axis, but their lengths are "
            f"{lengths}, 0 for no axis. {stack if isinstance(scenes, list | tuple) else ''}Repeat along it what all "
            "points share. The points around one scene are made by grid, latin_hypercube or sobol."
        )
    for name, leaf in leaves.items():
        if not jnp.issubdtype(leaf.dtype, jnp.number) and leaf.dtype != bool:
            raise ValueError(f"The arrays of the scenes must hold numbers, but {name!r} has type {leaf.dtype}.")
    (size,) = set(lengths.values())
    columns = {name: np.asarray(leaf) for name, leaf in leaves.items()}
    first = jax.tree.map(lambda leaf: leaf[0] if _is_array(leaf) else leaf, scenes)
    return Design(first, {"point": size}, columns, {name: ("point",) for name in columns}, "batch")


def _named_arrays(scenes) -> dict[str, Any]:
    """All arrays by the names that parameters have: an integer varies from point to point like any other number."""
    arrays = eqx.filter(scenes, _is_array)
    names = parameters(jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, float), arrays))
    return dict(zip(names, jax.tree.leaves(arrays), strict=True))


def _is_array(leaf) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray) or eqx.is_inexact_array(leaf)


def _size_of_box(scene, bounds: Bounds) -> int:
    """How many parameters a box has. Raises TypeError or ValueError where it is none."""
    if not isinstance(bounds, Mapping):
        raise TypeError(
            "`bounds` must be a mapping of parameters to lowest and highest values, {\"mass\": (1.0, 2.0)}, but is "
            f"{type(bounds).__name__}."
        )
    check_names(scene, bounds)
    if not bounds:
        raise ValueError("A box must have at least one parameter to vary, but has none.")
    for name, ends in bounds.items():
        if np.shape(ends) != (2,):
            raise ValueError(f"The bounds of {name!r} must be two numbers, (lowest, highest), but are {ends!r}.")
        if not (np.isfinite(ends).all() and ends[0] < ends[1]):
            raise ValueError(f"The bounds of {name!r} must be finite and increasing, but are ({ends[0]}, {ends[1]}).")
    return len(bounds)


def _table(scene, bounds: Bounds, unit: np.ndarray, kind: str) -> Design:
    box = {name: (float(low), float(high)) for name, (low, high) in bounds.items()}
    columns = {name: low + (high - low) * unit[:, i] for i, (name, (low, high)) in enumerate(box.items())}
    return Design(scene, {"point": len(unit)}, columns, {name: ("point",) for name in columns}, kind, box)


def _sobol_points(dimensions: int, points: Count, seed: int) -> np.ndarray:
    points = _positive(points)
    if points & (points - 1):
        below = 1 << (points.bit_length() - 1)
        raise ValueError(
            "The number of points of a Sobol sequence, and `base` of a Saltelli design, must be a power of two, but is "
            f"{points}: take {below} or {2 * below}."
        )
    return qmc.Sobol(dimensions, rng=np.random.default_rng(seed)).random_base2(points.bit_length() - 1)


def _positive(points: Count) -> int:
    return whole_number("The number of points", points)
