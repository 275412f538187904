"""Reductions of few numbers, written out.

XLA sets up three buffers for every reduction of a program each time that the program is called, a dozen for a search of
the largest: 0.1 us each, and a motion of ten contacts has ninety reductions. Of few numbers they are compiled as
quickly when written out. Of more they are left to XLA: written out, all that an entry is made from would be compiled
for each of them.
"""

import functools
import operator
from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.extend.core import JaxprEqn

FEW = 8
"""So many numbers are few, where one number is made of them."""
SHORT = 16
"""Vectors of so many entries are short: their product is written out. Steps are full of them: of a chain of 16 masses
they take a tenth of the time."""
VERY_FEW, SMALL = 4, 16
"""So many are few, where a result of up to so many entries is made of them."""

PAIRS = {
    lax.reduce_sum_p: operator.add,
    lax.reduce_max_p: lax.max,
    lax.reduce_min_p: lax.min,
    lax.reduce_or_p: operator.or_,
    lax.reduce_and_p: operator.and_,
}
"""What a reduction does with two numbers."""
ORDERS = {lax.argmax_p: operator.gt, lax.argmin_p: operator.lt}
"""Which of two numbers is wanted."""


def short_reduction(equation: JaxprEqn):
    """The reduction of few numbers, written out; None for another equation."""
    name, given = equation.primitive, [variable.aval for variable in equation.invars]
    result: Any = equation.outvars[0].aval if equation.outvars else None
    if name is lax.dot_general_p:
        return _dot if _is_short_dot(given, result, equation.params) else None
    if name not in PAIRS and name not in ORDERS:
        return None
    x: Any = given[0]
    (axis, *others) = equation.params["axes"] or (None,)
    if others or axis is None or x.size == 0:
        return None
    short = x.shape[axis] <= (FEW if result.size == 1 else VERY_FEW) and result.size <= SMALL
    if name in PAIRS:
        return (lambda x: functools.reduce(PAIRS[name], _parts(x, axis))) if short else None
    search = _first if short else _search
    return lambda x: search(name, x, axis, equation.params["index_dtype"])


def _is_short_dot(given, result, parameters) -> bool:
    """Whether it is that of two short vectors, added up in their own type."""
    return is_product_of_vectors(given, result, parameters) and 0 < given[0].size <= SHORT


def is_product_of_vectors(given, result, parameters) -> bool:
    (a, b), (contracted, _) = given, parameters["dimension_numbers"]
    return a.ndim == b.ndim == 1 and contracted == ((0,), (0,)) and a.dtype == b.dtype == result.dtype


def _dot(a, b):
    return functools.reduce(operator.add, [a[k] * b[k] for k in range(a.size)])


def _parts(x, axis):
    return [lax.index_in_dim(x, k, axis, keepdims=False) for k in range(x.shape[axis])]


def _first(name, x, axis, dtype):
    """Where the first of the numbers stands that is wanted before all others; one that is no number is."""
    wanted, (best, *others) = ORDERS[name], _parts(x, axis)
    place = jnp.zeros(best.shape, dtype)
    for k, part in enumerate(others, 1):
        better = wanted(part, best) | ((part != part) & (best == best))
        best, place = jnp.where(better, part, best), jnp.where(better, jnp.asarray(k, dtype), place)
    return place


def _search(name, x, axis, dtype):
    """The same for many numbers: what they are reduced to, and then where that is. Two plain reductions have half the
    buffers of one that carries a place. Of truth values one will do: where the first is that is wanted, if any."""
    place, last = lax.broadcasted_iota(dtype, x.shape, axis), jnp.iinfo(dtype).max
    if x.dtype == bool:
        first = jnp.min(jnp.where(x if name is lax.argmax_p else ~x, place, last), axis)
        return jnp.where(first == last, 0, first)
    best = (jnp.max if name is lax.argmax_p else jnp.min)(x, axis, keepdims=True)
    found = (x == best) | (x != x)
    return jnp.min(jnp.where(found, place, last), axis)
