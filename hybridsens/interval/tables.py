"""Bounds of what is interpolated in a table: `jnp.interp` over places that stand still.

Inside it is a search by a loop and entries read at places that move, which have no bounds one by one. So the call is
known by its trace as a whole.
"""

from functools import lru_cache

import jax
import jax.numpy as jnp

from . import jet as J
from .arithmetic import Interval, outward
from .jet import Jet

NAMES = ("interp", "_interp")
"""What JAX calls its program."""


def is_interpolation(equation) -> bool:
    """Whether an equation calls `jnp.interp` as it is by default: constant beyond both ends, without a period."""
    if equation.params.get("name") not in NAMES or len(equation.invars) != 3:
        return False
    types = tuple((atom.aval.shape, atom.aval.dtype, atom.aval.weak_type) for atom in equation.invars)
    return str(equation.params["jaxpr"]) == _default(types)


@lru_cache
def _default(types) -> str:
    """The trace of `jnp.interp` of arguments of these types."""
    arguments = [jax.ShapeDtypeStruct(shape, dtype, weak_type=weak) for shape, dtype, weak in types]
    (equation,) = jax.make_jaxpr(jnp.interp)(*arguments).eqns
    return str(equation.params["jaxpr"])


def interpolated(x: Jet, places, values) -> Jet:
    """`jnp.interp(x, places, values)`: of the places inside the range of x the values, and of all stretches that it
    meets the slopes; a second derivative only where it is one stretch."""
    places, values = (jnp.asarray(numbers, jnp.result_type(numbers, float)) for numbers in (places, values))
    low, high = x.value.low[..., None], x.value.high[..., None]
    inside = (places >= low) & (places <= high)
    ends = [jnp.interp(end, places, values) for end in x.value]
    lowest, highest = _extremes(values, inside)
    lowest, highest = jnp.minimum(lowest, jnp.minimum(*ends)), jnp.maximum(highest, jnp.maximum(*ends))
    margin = 8 * jnp.finfo(values.dtype).eps * jnp.max(jnp.abs(values))  # a value is a difference of its neighbours

    beyond = jnp.zeros(1, values.dtype)
    slopes = jnp.concatenate([beyond, jnp.diff(values) / jnp.diff(places), beyond])
    starts, stops = jnp.append(-jnp.inf, places), jnp.append(places, jnp.inf)
    met = (starts <= high) & (stops >= low)
    slope = outward(*_extremes(slopes, met))
    straight = jnp.where(jnp.any(inside, axis=-1), jnp.nan, 0.0)
    value = Interval(lowest - margin, highest + margin)
    return J.composed(x, value, slope, Interval(straight, straight))


def _extremes(numbers, which):
    """The least and the largest of those that are chosen along the last axis."""
    of = lambda reduce, none: reduce(jnp.where(which, numbers, none), axis=-1)
    return of(jnp.min, jnp.inf), of(jnp.max, -jnp.inf)
