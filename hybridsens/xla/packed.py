"""A PyTree of arrays as very few arrays, for where every array costs."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

_LARGE = 1000
"""Entries from which on an array stands alone: XLA looks for the origin of each entry of a vector that is put together,
which takes longer than a kernel."""


class _Layout(NamedTuple):
    """Where the leaves of a PyTree are in its packed form."""

    tree: Any
    shapes: tuple[tuple[tuple[int, ...], Any], ...]


class Packed(eqx.Module):
    """A PyTree of arrays as few arrays: its small floating leaves in one vector, its small integer ones in another."""

    floating: Array
    integer: Array
    """Integers and truth values."""
    separate: list[Array]
    """Leaves that are large, or of another type."""
    layout: _Layout = eqx.field(static=True)

    def unpack(self) -> Any:
        """The PyTree."""
        at, separate, leaves = {"floating": 0, "integer": 0}, iter(self.separate), []
        for shape, dtype in self.layout.shapes:
            if (kind := _kind(shape, dtype)) == "separate":
                leaves.append(next(separate))
                continue
            end = at[kind] + int(np.prod(shape))
            leaves.append(getattr(self, kind)[at[kind] : end].reshape(shape).astype(dtype))
            at[kind] = end
        return self.layout.tree.unflatten(leaves)


def pack(tree: Any) -> Packed:
    """A PyTree of arrays as few arrays."""
    leaves, structure = jax.tree.flatten(tree)
    leaves = [jnp.asarray(leaf) for leaf in leaves]
    parts: dict[str, list] = {"floating": [], "integer": [], "separate": []}
    for leaf in leaves:
        parts[_kind(leaf.shape, leaf.dtype)].append(leaf)
    layout = _Layout(structure, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
    return Packed(_joined(parts["floating"], float), _joined(parts["integer"], int), parts["separate"], layout)


def _joined(leaves, kind):
    """Leaves one after the other, in the widest of their types, or in the default one of their kind."""
    dtype = max([jnp.zeros(0, kind).dtype, *(leaf.dtype for leaf in leaves)], key=lambda dtype: dtype.itemsize)
    return jnp.concatenate([jnp.zeros(0, dtype), *(leaf.ravel().astype(dtype) for leaf in leaves)])


def _kind(shape, dtype) -> str:
    if int(np.prod(shape)) <= _LARGE:
        if dtype in (jnp.float32, jnp.float64):
            return "floating"
        if dtype in (jnp.int32, jnp.int64, jnp.bool_):
            return "integer"
    return "separate"
