"""Parameters by name: which leaves a scene has, and a scene with some of them replaced."""

import re
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

_ENTRY = re.compile(r"(?P<leaf>.+)\[(?P<index>\d+(, ?\d+)*)\]")


def parameters(scene: Any) -> dict[str, Any]:
    """The real array leaves of a scene by name: `mass`, or `initial.velocity` where they are nested."""
    leaves = jax.tree_util.tree_leaves_with_path(scene)
    return {_name(path): leaf for path, leaf in leaves if eqx.is_inexact_array(leaf) or _is_struct(leaf)}


def replace(scene: Any, values: dict[str, Any]) -> Any:
    """The scene with the named leaves, or entries of leaves such as `stiffness[1]`, replaced."""
    leaves, tree = jax.tree_util.tree_flatten_with_path(scene)
    place = {_name(path): number for number, (path, _) in enumerate(leaves)}
    new = [leaf for _, leaf in leaves]
    for name, value in values.items():
        leaf, index = split_name(name)
        old = new[place[leaf]]
        value = jnp.asarray(value, old.dtype)
        new[place[leaf]] = value if index is None else old.at[index].set(value)
    return tree.unflatten(new)


def split_name(name: str) -> tuple[str, tuple[int, ...] | None]:
    """`stiffness[1]` -> ("stiffness", (1,)); `mass` -> ("mass", None)."""
    match = _ENTRY.fullmatch(name)
    if match is None:
        return name, None
    return match["leaf"], tuple(int(part) for part in match["index"].split(","))


def check_names(scene: Any, names) -> None:
    """Raises ValueError unless every name is a scalar parameter of the scene, or a scalar entry of one."""
    known = parameters(scene)
    for name in names:
        leaf, index = split_name(name)
        if leaf not in known:
            raise ValueError(f"A parameter must have one of the names {', '.join(known)}, but has the name {name!r}.")
        shape = known[leaf].shape
        inside = (
            index is not None and len(index) == len(shape) and all(i < n for i, n in zip(index, shape, strict=True))
        )
        if not inside and (index is not None or shape != ()):
            raise ValueError(
                f"{leaf!r} has shape {shape}, so its entries must be named one by one, such as "
                f"'{leaf}[{', '.join('0' for _ in shape)}]', but the name is {name!r}."
                if shape
                else f"{leaf!r} is a scalar and must be named without an index, but the name is {name!r}."
            )


def _name(path) -> str:
    return jax.tree_util.keystr(path, simple=True, separator=".") or "value"


def _is_struct(leaf) -> bool:
    return isinstance(leaf, jax.ShapeDtypeStruct) and jnp.issubdtype(leaf.dtype, jnp.inexact)
