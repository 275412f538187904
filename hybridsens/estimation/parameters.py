"""Which numbers of a scene are fitted, and how bounds are kept: by a transformation, so that no optimizer sees them.

An unknown z in R stands for each fitted value p:

    free       p = scale z              above lo     p = lo + scale exp(z)
    below hi   p = hi - scale exp(z)    in (lo, hi)  p = (lo + hi) / 2 + (hi - lo) / 2 sin(z)

The sine stays steep near its ends; a logistic curve flattens there, and a guess near a bound then takes many steps.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..parameters import as_written, check_names, entry_names, parameter_places, split_name, with_parts
from ..validation.arguments import as_real, by_name, pair
from ..validation.spelling import did_you_mean

Bounds = Mapping[str, Any]
"""Name -> "positive", or (lo, hi) where None is an open end."""
_INSIDE = 1e-6
"""Where a guess on its bound begins, as a part of its size, or of the distance of two bounds."""


class Part(NamedTuple):
    """One name among the fitted ones."""

    position: int
    """Which leaf of the flattened scene it is of."""
    index: tuple[int, ...]
    """Which entry of it; () for all."""
    shape: tuple[int, ...]
    """Of the numbers."""

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return int(np.prod(self.shape))


class Selection(eqx.Module):
    """The fitted entries of a scene, as one vector."""

    labels: tuple[str, ...] = eqx.field(static=True)
    """One for each fitted number; entries of an array are name[0], name[1], ..."""
    parts: tuple[Part, ...] = eqx.field(static=True)
    """Arrays or entries of them, in the order of the labels."""
    lower: Float[Array | np.ndarray, "parameter"]
    """Lower bounds, -inf where there is none."""
    upper: Float[Array | np.ndarray, "parameter"]
    """Upper bounds, inf where there is none."""
    scale: Float[Array | np.ndarray, "parameter"]
    """Size of a parameter, from the guess; where that is 0 it is 1, or what `sizes.py` finds."""

    def values(self, scene) -> Float[Array, "parameter"]:
        """The fitted numbers of a scene."""
        leaves = jax.tree.leaves(scene)
        return jnp.concatenate([jnp.ravel(leaves[part.position][part.index]) for part in self.parts])

    def insert(self, scene, values: Float[Array, "parameter"]):
        """The scene with other numbers in the fitted places."""
        leaves, tree = jax.tree.flatten(scene)
        start = 0
        for part in self.parts:
            new = values[start : start + part.size].reshape(part.shape)
            leaf = leaves[part.position]
            leaves[part.position] = new.astype(leaf.dtype) if part.index == () else leaf.at[part.index].set(new)
            start += part.size
        return tree.unflatten(leaves)

    def to_values(self, z: Float[Array, "parameter"]) -> Float[Array, "parameter"]:
        """p(z), within the bounds for every z."""
        below, above = jnp.isfinite(self.lower), jnp.isfinite(self.upper)
        lower, upper = jnp.where(below, self.lower, 0), jnp.where(above, self.upper, 0)
        growing = self.scale * jnp.exp(jnp.where(below ^ above, z, 0))
        one_sided = jnp.where(below, lower + growing, upper - growing)
        both = (lower + upper) / 2 + (upper - lower) / 2 * jnp.sin(z)
        return jnp.where(below & above, both, jnp.where(below | above, one_sided, self.scale * z))

    def from_values(self, values: Float[Array | np.ndarray, "parameter"]) -> Float[Array, "parameter"]:
        """z(p), for values within their bounds; of the many z of a sine the one in (-pi/2, pi/2).

        On a bound p(z) is flat, and nothing leads away from there: values are put a millionth of their size inside.
        """
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        p, lower, upper = np.asarray(values), self.lower, self.upper
        with np.errstate(all="ignore"):  # every branch is computed, one of them is meant
            one_sided = np.log(np.maximum(np.where(below, p - lower, upper - p) / self.scale, _INSIDE))
            both = np.arcsin(np.clip((2 * p - lower - upper) / (upper - lower), 2 * _INSIDE - 1, 1 - 2 * _INSIDE))
        return jnp.asarray(np.where(below & above, both, np.where(below | above, one_sided, p / self.scale)))


def select(scene, parameters: str | Sequence[str] | None, bounds: Bounds | None = None) -> Selection:
    """The parameters with these names (None: all; a string: that one), within these bounds.

    Names are those of whole arrays, `mass`, of entries, `mass[0]`, or of parts that hold arrays, `network`.
    Raises: ValueError for a name that the scene does not have, a number named twice, bounds in the wrong order, or a
    guess that does not lie within its bounds.
    """
    known = parameter_places(scene)
    if isinstance(parameters, str):
        parameters = [parameters]
    names = list(known) if parameters is None else list(parameters)
    values = [name for name in names if not isinstance(name, str)]
    if values:
        raise TypeError(f"`parameters` must be names, such as {next(iter(known), 'name')!r}, but has {values[0]!r}.")
    names, bounds = with_parts(names, known), by_entry("bounds", bounds)
    if not names:
        raise ValueError(f"`parameters` must have each name once and at least one, but has {names}.")
    arrays = [name if name in known else _of_entry(scene, name, known) for name in names]
    _check_names("`parameters`", arrays, list(known))
    leaves = jax.tree.leaves(scene)
    parts = tuple(_part(name, known, leaves) for name in names)
    entries = [[name] if part.index else entry_names(name, part.shape) for name, part in zip(names, parts, strict=True)]
    labels = [label for of_part in entries for label in of_part]
    _check_names("`bounds`", list(bounds), list(dict.fromkeys([*names, *labels])))
    _check_once(labels)
    whole = {label: bounds.get(name) for name, of_part in zip(names, entries, strict=True) for label in of_part}
    lower, upper = np.array([_ends(label, bounds.get(label, whole[label])) for label in labels], float).T
    guess = np.concatenate([np.ravel(np.asarray(leaves[part.position])[part.index]) for part in parts])
    scale = np.where(guess == 0, 1.0, np.abs(guess))
    selection = Selection(tuple(labels), parts, lower, upper, scale)
    check_inside("guess", selection, guess)
    return selection


def _check_names(what: str, names: list[str], known: list[str]) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        several = unknown[0].replace(",", " ").split()
        meant = did_you_mean(unknown, known)
        if len(several) > 1 and set(several) <= set(known):
            meant = f" Give a list: {several}."
        raise ValueError(f"{what} must have names among {known}, but has {unknown}.{meant}")


def _check_once(labels: list[str]) -> None:
    """Raises: ValueError for a number that is named twice, by itself or as one of an array."""
    twice = [label for label, count in Counter(labels).items() if count > 1]
    if twice:
        raise ValueError(f"`parameters` must have each name once, but has {twice[0]!r} more than once.")


def _of_entry(scene, name: str, known: Mapping[str, int]) -> str:
    """The array that `mass[0]` names an entry of. Raises: ValueError where it has no such entry."""
    leaf, index = split_name(name)
    if index is None or leaf not in known:
        return name
    check_names(scene, [name])
    return leaf


def _part(name: str, known: Mapping[str, int], leaves: list[Any]) -> Part:
    leaf, index = (name, None) if name in known else split_name(name)
    shape = np.shape(leaves[known[leaf]])
    return Part(known[leaf], (), shape) if index is None else Part(known[leaf], index, ())


def by_entry(what: str, given: Mapping[str, Any] | None) -> dict[str, Any]:
    """What is given by name, with names of entries written as in `entry_names`.

    Raises: ValueError for an entry that is named in two ways."""
    given = by_name(what, given)
    found = {as_written(name) if isinstance(name, str) else name: value for name, value in given.items()}
    if len(found) < len(given):
        raise ValueError(f"`{what}` must name each entry once, but has {list(given)}.")
    return found


def _ends(name: str, bound: Any) -> tuple[float, float]:
    if bound is None:
        return -np.inf, np.inf
    if isinstance(bound, str):
        if bound != "positive":
            raise ValueError(f'The bound of {name!r} must be "positive" or a pair (lo, hi), but is {bound!r}.')
        return 0.0, np.inf
    ends = pair(bound)
    if ends is None:
        raise ValueError(
            f'The bounds of {name!r} must be "positive" or a pair (lo, hi), None for an open end, but are {bound!r}.'
        )
    lo, hi = (infinite if end is None else as_real(end) for end, infinite in zip(ends, (-np.inf, np.inf), strict=True))
    if not lo < hi:
        raise ValueError(f"The bounds of {name!r} must be numbers with lo < hi, but are {bound!r}.")
    return lo, hi


def check_inside(what: str, selection: Selection, values: np.ndarray) -> None:
    """Raises: ValueError for a value that is not finite, or beyond its bounds."""
    for label, p, lo, hi in zip(selection.labels, values, selection.lower, selection.upper, strict=True):
        if not np.isfinite(p) or not lo <= p <= hi:
            raise ValueError(f"The {what} of {label!r} must lie within its bounds [{lo}, {hi}], but is {p}.")
