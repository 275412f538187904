"""A scene as one vector of parameters, with a name for each entry."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float


class FlatParameters(NamedTuple):
    """The floating point leaves of a scene, in one vector."""

    names: tuple[str, ...]
    """Path of each entry: `distance`, or `mass[0]` in an array."""
    vector: Float[Array, "parameter"]
    rebuild: Callable[[Float[Array, "parameter"]], Any]
    """The scene with the entries of a vector in their places."""


def flatten_parameters(scene) -> FlatParameters:
    """All parameters of a scene, or of any other PyTree that holds them.

    Raises: ValueError if there are none.
    """
    arrays, rest = eqx.partition(scene, eqx.is_inexact_array)
    vector, unravel = ravel_pytree(arrays)
    if vector.size == 0:
        raise ValueError("`scene` must have at least one floating point array as a parameter, but has none.")
    with_paths = jax.tree_util.tree_flatten_with_path(arrays)[0]
    names = [name for path, leaf in with_paths for name in _names(path, np.shape(leaf))]
    return FlatParameters(tuple(names), vector, lambda vector: eqx.combine(unravel(vector), rest))


def _names(path, shape) -> list[str]:
    name = jax.tree_util.keystr(path, simple=True, separator=".") or "p"
    return [name + (f"[{','.join(map(str, index))}]" if index else "") for index in np.ndindex(*shape)]
