"""A PyTree as named arrays, and back: what a running cost or the state of a hybrid system is made of."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from ..delays import DelayQueue
from .names import must_differ
from .text import Numbers, array_text


def named_leaves(name: str, tree: Any) -> dict[str, np.ndarray]:
    """Name -> array; see `leaves_by_name`."""
    return {label: np.asarray(leaf) for label, leaf in leaves_by_name(name, tree).items()}


def leaves_by_name(name: str, tree: Any) -> dict[str, Any]:
    """Name -> leaf as it is, with the place in the tree behind the name: cost, cost.work, cost.forces.0.

    Raises: ValueError where two leaves would have one name, as {"a": {"b": ...}, "a.b": ...}."""
    leaves = jax.tree_util.tree_leaves_with_path({name: tree})
    names = [jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in leaves]
    must_differ(names, "Leaves of a state, a mode or a cost", "the system")
    return dict(zip(names, (leaf for _, leaf in leaves), strict=True))


def variables(name: str, tree: Any, *leading: str, like: str = "") -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Name -> (dimensions, array), as xarray takes them. The first dimensions are those given, the others are named
    after the leaf, or after that of the tree `like` which it is shaped as."""
    found = {}
    for label, leaf in named_leaves(name, tree).items():
        base = like + label.removeprefix(name) if like else label
        found[label] = (*leading, *(f"{base}.axis{axis}" for axis in range(leaf.ndim - len(leading)))), leaf
    return found


def structure(name: str, tree: Any) -> Any:
    """The tree as JSON can hold it, with the name of each array in its place.

    Raises: TypeError for a tree of anything but dict, list, tuple, `DelayQueue`, None and arrays; ValueError for a key
    that a file cannot have as a name."""
    if tree is None:
        return None
    if type(tree) is dict and all(isinstance(key, str) for key in tree):
        _check_keys(name, tree)
        return {"dict": {key: structure(f"{name}.{key}", entry) for key, entry in tree.items()}}
    if type(tree) in (list, tuple):
        return {type(tree).__name__: [structure(f"{name}.{i}", entry) for i, entry in enumerate(tree)]}
    if isinstance(tree, DelayQueue):
        return {"DelayQueue": {part: f"{name}.{part}" for part in ("taken", "full")}}
    if isinstance(tree, jax.Array | np.ndarray | float):
        return name
    raise TypeError(
        f"`{name}` can be saved if it is made of dict (with strings as keys), list, tuple and arrays, but it holds "
        f"{type(tree).__name__}. Save what `to_xarray()` returns, by its `to_netcdf`."
    )


def _check_keys(name: str, tree: dict[str, Any]) -> None:
    for key in tree:
        if "/" in key or key != key.strip():
            raise ValueError(
                f"`{name}` can be saved if its keys have no slash, and no blank at an end, since a netCDF file takes "
                f"none, but it has {key!r}: rename it."
            )


def restored(outline: Any, arrays: Mapping[str, Any]) -> Any:
    """The tree of such an outline."""
    if outline is None:
        return None
    if isinstance(outline, str):
        return arrays[outline]
    ((kind, entries),) = outline.items()
    if kind in ("dict", "DelayQueue"):
        found = {key: restored(entry, arrays) for key, entry in entries.items()}
        return found if kind == "dict" else DelayQueue(**found)
    return {"list": list, "tuple": tuple}[kind](restored(entry, arrays) for entry in entries)


def as_text(tree: Any) -> str:
    """The tree as a text in which arrays are their numbers."""

    def shown(leaf):
        if isinstance(leaf, DelayQueue):
            return Numbers(f"{int(np.sum(leaf.taken))} of {np.size(leaf.taken)} wait")
        return Numbers(array_text(leaf, threshold=8, edgeitems=2))  # str() of one number would show all of its digits

    return str(jax.tree.map(shown, tree, is_leaf=lambda part: isinstance(part, DelayQueue)))
