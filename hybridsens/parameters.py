"""The parameters of a scene or a system by name: `mass`, `arm.length`, and `mass[0, 1]` for an entry of an array.

A parameter is a leaf with a floating point type. Every study names them by the rule of this file.
"""

import operator
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from .validation.spelling import did_you_mean

_ENTRY = re.compile(r"(?P<leaf>.+)\[(?P<index>\d+(, ?\d+)*)\]")
_PLACE = re.compile(r"\[(\d+)\]\.")
"""A place in a list as Python has it, `layers[0].bias`; a path has `layers.0.bias`."""


class FlatParameters(NamedTuple):
    """All parameters in one vector."""

    names: tuple[str, ...]
    """Name of each entry."""
    vector: Float[Array, "parameter"]
    rebuild: Callable[[Float[Array, "parameter"]], Any]
    """The scene with the entries of a vector in their places."""

    def only(self, chosen: Sequence[str]) -> "FlatParameters":
        """Those of the chosen arrays, and chosen entries of arrays; the others stay as they are.

        Raises: ValueError for a name that is not among them, or for none."""
        arrays = [split_name(name)[0] for name in self.names]
        chosen = with_parts(chosen, dict.fromkeys(arrays))
        unknown = [name for name in chosen if name not in self.names and name not in arrays]
        if unknown or not chosen:
            known = list(dict.fromkeys(arrays))
            raise ValueError(
                f"`parameters` must be names among {', '.join(known)}, or of their entries, such as {self.names[0]!r}, "
                f"but are {chosen}.{did_you_mean(unknown, known)}"
            )
        kept = [k for k, name in enumerate(self.names) if name in chosen or arrays[k] in chosen]
        whole, places = self.vector, np.array(kept)
        rebuild = lambda vector: self.rebuild(whole.at[places].set(vector))
        return FlatParameters(tuple(self.names[k] for k in kept), whole[places], rebuild)


def flatten_parameters(scene: Any) -> FlatParameters:
    """All parameters of a scene, or of any other PyTree that holds them.

    Raises: ValueError if there are none.
    """
    arrays, rest = eqx.partition(scene, eqx.is_inexact_array)
    vector, unravel = ravel_pytree(arrays)
    if vector.size == 0:
        raise ValueError(
            "`scene` must have at least one floating point array as a parameter, but has none. Declare its fields as "
            "jax.Array: numbers given for them become arrays."
        )
    names = [entry for name, leaf in parameters(arrays).items() for entry in entry_names(name, np.shape(leaf))]
    return FlatParameters(tuple(names), vector, lambda vector: eqx.combine(unravel(vector), rest))


def parameters(scene: Any) -> dict[str, Any]:
    """The parameters by name."""
    leaves = jax.tree_util.tree_leaves_with_path(scene)
    return {_name(path): leaf for path, leaf in leaves if eqx.is_inexact_array(leaf) or _is_struct(leaf)}


def parameter_places(scene: Any) -> dict[str, int]:
    """Name of each parameter -> its place among all leaves."""
    leaves = jax.tree_util.tree_leaves_with_path(scene)
    return {_name(path): place for place, (path, leaf) in enumerate(leaves) if eqx.is_inexact_array(leaf)}


def entry_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Names of the entries of one parameter: `mass` of a scalar, `mass[0, 1]` of an array."""
    return [f"{name}[{', '.join(map(str, index))}]" if index else name for index in np.ndindex(*shape)]


def split_name(name: str) -> tuple[str, tuple[int, ...] | None]:
    """`stiffness[1]` -> ("stiffness", (1,)); `mass` -> ("mass", None); `layers[0].bias` is `layers.0.bias`."""
    match = _ENTRY.fullmatch(name)
    if match is None:
        return _PLACE.sub(r".\1.", name), None
    return _PLACE.sub(r".\1.", match["leaf"]), tuple(int(part) for part in match["index"].split(","))


def as_written(name: str) -> str:
    """The name as `entry_names` has it: mass[0, 1] for mass[0,1]."""
    leaf, index = split_name(name)
    return leaf if index is None else f"{leaf}[{', '.join(map(str, index))}]"


def with_parts(names: Sequence[str], known: Iterable[str]) -> list[str]:
    """The names as they are written, with all parameters of a part, as a network, in the place of its name."""
    known = list(known)

    def within(part):
        path = re.sub(r"\[(\d+)\]", r".\1", part)  # layers[1] is a part, as weight[1] is an entry
        return [name for name in known if name.startswith(f"{path}.")]

    return [name for given in map(as_written, names) for name in (within(given) or [given])]


def replace(scene: Any, values: dict[str, Any]) -> Any:
    """The scene with the named parameters, or entries of them, replaced."""
    leaves, tree = jax.tree_util.tree_flatten_with_path(scene)
    place = {_name(path): number for number, (path, _) in enumerate(leaves)}
    new = [leaf for _, leaf in leaves]
    for name, value in values.items():
        leaf, index = split_name(name)
        old = new[place[leaf]]
        value = jnp.asarray(value, old.dtype)
        new[place[leaf]] = value if index is None else old.at[index].set(value)
    return tree.unflatten(new)


def check_names(scene: Any, names) -> None:
    """Raises ValueError unless every name is a scalar parameter of the scene, or a scalar entry of one, and no two are
    the same one."""
    known, seen = parameters(scene), {}
    for name in names:
        leaf, index = split_name(name)
        if (leaf, index) in seen:
            raise ValueError(f"Each parameter must be named once, but {seen[leaf, index]!r} and {name!r} are one.")
        seen[leaf, index] = name
        if leaf not in known:
            declare = " It is a constant: declare its field as jax.Array." if leaf in _all_names(scene) else ""
            raise ValueError(
                f"A parameter must have one of the names {', '.join(known) or '(there are none)'}, but has the name "
                f"{name!r}.{declare or did_you_mean(leaf, known)}"
            )
        shape = known[leaf].shape
        is_scalar = shape == () if index is None else len(index) == len(shape) and all(map(operator.lt, index, shape))
        if not is_scalar:
            raise ValueError(
                f"{leaf!r} has shape {shape}, so its entries must be named one by one, such as "
                f"'{leaf}[{', '.join('0' for _ in shape)}]', but the name is {name!r}."
                if shape
                else f"{leaf!r} is a scalar and must be named without an index, but the name is {name!r}."
            )


def _all_names(scene: Any) -> set[str]:
    return {_name(path) for path, _ in jax.tree_util.tree_leaves_with_path(scene)}


def _name(path) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".") or "value"


def _is_struct(leaf) -> bool:
    return isinstance(leaf, jax.ShapeDtypeStruct) and jnp.issubdtype(leaf.dtype, jnp.inexact)
