"""Arguments of the entry points: numbers, arrays, pairs and mappings, checked by their names before anything runs."""

import math
import operator
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .asked import kind_of


def real_array(name: str, value, ndim: int, axis: str = "sample") -> jax.Array:
    """`value` as an array of real numbers with so many axes. Raises: TypeError or ValueError with its name."""
    try:
        array = jnp.asarray(float(value) if isinstance(value, int) else value)
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"`{name}` must hold real numbers, but is {type(value).__name__}.") from error
    if not any(jnp.issubdtype(array.dtype, kind) for kind in (jnp.floating, jnp.integer, jnp.bool_)):
        raise TypeError(f"`{name}` must hold real numbers, but has type {array.dtype}.")
    if array.ndim != ndim:
        expected = ["()", f"({axis},)"][ndim]
        one = name == "ts" and array.ndim == 0
        remedy = ": give the times themselves, as `jnp.linspace(t0, t1, 100)`" if one else ""
        raise ValueError(f"`{name}` must have shape {expected}, but has shape {array.shape}{remedy}.")
    return array


def real_tolerance(name: str, value):
    """A positive number, or a scalar array whose value is looked at when the motion runs."""
    if isinstance(value, jax.Array):
        return real_array(name, value, 0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= 1e308:
        raise ValueError(f"`{name}` must be a positive number, but is {value!r}.")
    return float(value)


def real_fraction(name: str, value):
    """A number in [0, 1), or a scalar array whose value is looked at when the motion runs."""
    if isinstance(value, jax.Array):
        return real_array(name, value, 0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < 1:
        raise ValueError(f"`{name}` must lie in [0, 1), but is {value!r}.")
    return float(value)


def check_mesh(*given) -> None:
    """Raise ValueError inside of a `jax.shard_map` that follows what varies over the mesh, and where arrays lie on a
    mesh with explicit axes that is not the one in use.

    Both ask that what a loop carries has one type from the start to the end. The loops of Diffrax begin with
    constants, which vary over nothing and lie on the mesh in use, so that no care taken here would do."""
    kinds = [jax.typeof(leaf) for leaf in jax.tree.leaves(given) if isinstance(leaf, jax.Array)]
    explicit = sorted({str(axis) for kind in kinds for axis in kind.sharding.mesh.explicit_axes})
    if explicit and jax.sharding.get_abstract_mesh().empty:
        raise ValueError(
            "Arrays of a motion must not lie on a mesh with explicit axes outside of `with jax.set_mesh(mesh)`, but "
            f"some lie on one with the explicit axes {explicit}: give jax.make_mesh "
            "axis_types=(jax.sharding.AxisType.Auto,) for each axis, or use hybridsens.sweep."
        )
    over = sorted({str(axis) for kind in kinds for axis in _varies_over(kind)})
    if over:
        raise ValueError(
            "Inside of jax.shard_map a motion must be computed with check_vma=False, but here JAX follows what varies "
            f"over the mesh axes {over}: give jax.shard_map the argument check_vma=False, or use hybridsens.sweep."
        )


def _varies_over(kind):
    """Mesh axes that a value is known to vary over; JAX 0.10 keeps them elsewhere than JAX 0.7."""
    return getattr(getattr(kind, "manual_axis_type", None), "varying", ()) or getattr(kind, "vma", ())


def in_type(tree: Any, dtype) -> Any:
    """The tree with its real arrays in that type, and none of a weak one, such as `jnp.array(1.0)` has: within a
    program it would be strong, for which all would be traced once more."""
    is_real = lambda leaf: eqx.is_inexact_array(leaf) and jnp.issubdtype(leaf.dtype, jnp.floating)
    other = lambda leaf: is_real(leaf) and (leaf.dtype != dtype or getattr(leaf, "weak_type", False))
    if not any(map(other, jax.tree.leaves(tree))):
        return tree
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype) if other(leaf) else leaf, tree)


def whole_number(what: str, value: Any, least: int = 1) -> int:
    """A Python integer. Raises: ValueError where it is none, of Python, NumPy or JAX, or too small."""
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is None or number < least:
        raise ValueError(f"{what} must be an integer >= {least}, but is {value!r}.")
    return number


def by_name(name: str, given: Any) -> dict[str, Any]:
    """A mapping by names of parameters; empty for None. Raises: TypeError for what is none."""
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(f"`{name}` must be a mapping by names of parameters, but is {shown(given)}.")
    return dict(given or {})


def pair(given: Any) -> tuple[Any, Any] | None:
    """The two entries of a tuple, list or array; None for anything else."""
    two = isinstance(given, tuple | list | np.ndarray | jax.Array) and len(given) == 2
    return (given[0], given[1]) if two else None


def as_real(given: Any) -> float:
    """A real number; NaN for what is none."""
    try:
        return math.nan if isinstance(given, str) else float(given)
    except (TypeError, ValueError):
        return math.nan


def shown(given: Any) -> str:
    """What was given: a text or a number itself, else what it is."""
    return repr(given) if isinstance(given, str | int | float) else kind_of(given)
