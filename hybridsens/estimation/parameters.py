"""Which leaves of a scene are fitted, and how bounds are kept: by a transformation, so that no optimizer sees them.

An unknown z in R stands for each fitted value p:

    free       p = scale z              above lo     p = lo + scale exp(z)
    below hi   p = hi - scale exp(z)    in (lo, hi)  p = (lo + hi) / 2 + (hi - lo) / 2 sin(z)

The sine stays steep near its ends; a logistic curve flattens there, and a guess near a bound then takes many steps.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..parameters import entry_names, parameter_places
from ..validation.arguments import as_real, by_name, pair
from ..validation.spelling import did_you_mean

Bounds = Mapping[str, Any]
"""Name -> "positive", or (lo, hi) where None is an open end."""
_INSIDE = 1e-6
"""Where a guess on its bound begins, as a part of its size, or of the distance of two bounds."""


class Selection(eqx.Module):
    """The fitted entries of a scene, as one vector."""

    labels: tuple[str, ...] = eqx.field(static=True)
    """One for each fitted number; entries of an array are name[0], name[1], ..."""
    positions: tuple[int, ...] = eqx.field(static=True)
    """Which leaves of the flattened scene are fitted."""
    shapes: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Shapes of those leaves."""
    lower: Float[Array | np.ndarray, "parameter"]
    """Lower bounds, -inf where there is none."""
    upper: Float[Array | np.ndarray, "parameter"]
    """Upper bounds, inf where there is none."""
    scale: Float[Array | np.ndarray, "parameter"]
    """Size of a parameter, from the guess; where that is 0 it is 1, or what `sizes.py` finds."""

    def values(self, scene) -> Float[Array, "parameter"]:
        """The fitted numbers of a scene."""
        leaves = jax.tree.leaves(scene)
        return jnp.concatenate([jnp.ravel(leaves[position]) for position in self.positions])

    def insert(self, scene, values: Float[Array, "parameter"]):
        """The scene with other numbers in the fitted places."""
        leaves, tree = jax.tree.flatten(scene)
        start = 0
        for position, shape in zip(self.positions, self.shapes, strict=True):
            size = int(np.prod(shape))
            leaves[position] = values[start : start + size].reshape(shape).astype(leaves[position].dtype)
            start += size
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

    Raises: ValueError for a name that the scene does not have, a name given twice, bounds in the wrong order, or a
    guess that does not lie within its bounds.
    """
    known = parameter_places(scene)
    if isinstance(parameters, str):
        parameters = [parameters]
    names = list(known) if parameters is None else list(parameters)
    values = [name for name in names if not isinstance(name, str)]
    if values:
        raise TypeError(f"`parameters` must be names, such as {next(iter(known), 'name')!r}, but has {values[0]!r}.")
    bounds = by_name("bounds", bounds)
    _check_names("`parameters`", names, list(known))
    _check_names("`bounds`", list(bounds), names)
    leaves = jax.tree.leaves(scene)
    positions = tuple(known[name] for name in names)
    shapes = tuple(tuple(np.shape(leaves[position])) for position in positions)
    labels = [label for name, shape in zip(names, shapes, strict=True) for label in entry_names(name, shape)]
    sizes = [int(np.prod(shape)) for shape in shapes]
    ends = [_ends(name, bounds.get(name)) for name in names]
    lower, upper = (np.repeat([end[side] for end in ends], sizes).astype(float) for side in (0, 1))
    guess = np.concatenate([np.ravel(np.asarray(leaves[position])) for position in positions])
    scale = np.where(guess == 0, 1.0, np.abs(guess))
    selection = Selection(tuple(labels), positions, shapes, lower, upper, scale)
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
    if not names and what == "`parameters`" or len(set(names)) != len(names):
        raise ValueError(f"{what} must have each name once and at least one, but has {names}.")


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
