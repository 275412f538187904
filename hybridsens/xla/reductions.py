"""Reductions of few numbers, written out, and of many, cut into pieces.

XLA sets up three buffers for every reduction of a program each time that the program is called, a dozen for a search of
the largest: 0.1 us each, and a motion of ten contacts has ninety reductions. Of few numbers they are compiled as
quickly when written out. Of some more they are left to XLA: written out, all that an entry is made from would be
compiled for each of them.

XLA turns a reduction of 32 numbers or more into windows of 32 and what is left of these, and a running sum into as many
windows as it has numbers. A loop over windows takes LLVM a twentieth of a second to compile, and a motion of 64
contacts would have three hundred of them. And its numbers are taken one after the other, where the entries of pieces
are taken side by side.
"""

import functools
import operator
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import JaxprEqn

FEW = 8
"""Where the result is one number, up to so many are written out."""
SHORT = 16
"""Vectors of so many entries are short: their product is written out. Steps are full of them: of a chain of 16 masses
they take a tenth of the time."""
VERY_FEW, SMALL = 4, 16
"""Where the result has up to `SMALL` entries, each made of up to `VERY_FEW` numbers, these are written out."""

add_up = functools.partial(jnp.sum, promote_integers=False)

REDUCTIONS = {
    lax.reduce_sum_p: (operator.add, add_up),
    lax.reduce_max_p: (lax.max, jnp.max),
    lax.reduce_min_p: (lax.min, jnp.min),
    lax.reduce_or_p: (operator.or_, lambda x, axis: lax.reduce_or(x, (axis,))),  # of integers bit by bit
    lax.reduce_and_p: (operator.and_, lambda x, axis: lax.reduce_and(x, (axis,))),
}
"""What a reduction does with two numbers, and with all of an axis."""
ORDERS = {lax.argmax_p: operator.gt, lax.argmin_p: operator.lt}
"""The comparison that each of them uses."""


def short_reduction(equation: JaxprEqn):
    """The reduction of few numbers, written out; None for another equation."""
    name, given = equation.primitive, [variable.aval for variable in equation.invars]
    result: Any = equation.outvars[0].aval if equation.outvars else None
    if name is lax.dot_general_p:
        return _dot if _is_short_dot(given, result, equation.params) else None
    if name not in REDUCTIONS and name not in ORDERS:
        return None
    x: Any = given[0]
    (axis, *others) = equation.params["axes"] or (None,)
    if others or axis is None or x.size == 0:
        return None
    short = x.shape[axis] <= (FEW if result.size == 1 else VERY_FEW) and result.size <= SMALL
    if name in REDUCTIONS:
        return (lambda x: functools.reduce(REDUCTIONS[name][0], _parts(x, axis))) if short else None
    search = _first if short else _search
    return lambda x: search(name, x, axis, equation.params["index_dtype"])


def _is_short_dot(given, result, parameters) -> bool:
    """The same of two short ones."""
    return is_product_of_vectors(given, result, parameters) and 0 < given[0].size <= SHORT


def is_product_of_vectors(given, result, parameters) -> bool:
    """Whether a product is that of two vectors, added up in their own type."""
    (a, b), (contracted, _) = given, parameters["dimension_numbers"]
    return a.ndim == b.ndim == 1 and contracted == ((0,), (0,)) and a.dtype == b.dtype == result.dtype


def _dot(a, b):
    return functools.reduce(operator.add, [a[k] * b[k] for k in range(a.size)])


def _parts(x, axis):
    return [lax.index_in_dim(x, k, axis, keepdims=False) for k in range(x.shape[axis])]


def _first(name, x, axis, dtype):
    """Index of the first largest (or smallest) number; as in JAX, nan counts as the extreme."""
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


WINDOW = 32
"""So many numbers XLA reduces by windows."""
PIECES, LONG, LONGEST = 8, 128, 2**14
"""More than `LONG` numbers are cut into so many pieces, and these again. All that an entry is made from would be
compiled for each piece then, so it is worked out before. More than `LONGEST` are left to XLA."""
RUNNING = 64
"""The longest running sum that is made from a square of numbers, which takes n^2 operations."""


def long_reduction(equation: JaxprEqn):
    """The reduction of many numbers, in pieces; None for another equation."""
    name = equation.primitive
    given: list[Any] = [variable.aval for variable in equation.invars]
    if name is lax.cumsum_p:
        return _running_sum(given[0], **equation.params)
    if name is lax.dot_general_p:
        result: Any = equation.outvars[0].aval
        vectors = is_product_of_vectors(given, result, equation.params) and _is_long(given[0].size)
        return (lambda a, b: add_up(a * b)) if vectors else None
    if name not in REDUCTIONS or len(equation.params["axes"]) != 1:
        return None
    x, (axis,) = given[0], equation.params["axes"]
    return (lambda x: _in_pieces(name, x, axis)) if _is_long(x.shape[axis]) else None


def _is_long(count: int) -> bool:
    return WINDOW <= count <= LONGEST


def _in_pieces(name, x, axis):
    """Pieces of equal length put together entry by entry; then the entries of these, and those that were left over."""
    count = x.shape[axis]
    length = min(range(WINDOW // 2, WINDOW), key=lambda length: (count % length, -length))
    if count > LONG:
        x, length = lax.optimization_barrier(x), count // PIECES
    end = count - count % length
    pieces = [lax.slice_in_dim(x, k, k + length, axis=axis) for k in range(0, end, length)]
    rest = [lax.index_in_dim(x, k, axis, keepdims=False) for k in range(end, count)]
    of_two, of_axis = REDUCTIONS[name]
    return functools.reduce(of_two, [of_axis(functools.reduce(of_two, pieces), axis), *rest])


def _running_sum(x, axis, reverse):
    """Sums of all entries up to each one, or from each one on: those of the rows of a square that has zeros in the
    place of the others. As a product with ones and zeros, one infinite entry would spoil all of them."""
    count = x.shape[axis]
    if not jnp.issubdtype(x.dtype, jnp.floating) or not 0 < count <= RUNNING:
        return None
    belongs = np.tri(count, dtype=bool)
    belongs = belongs.T if reverse else belongs

    def sums(x):
        rows = jnp.where(belongs, jnp.moveaxis(x, axis, -1)[..., None, :], 0)
        return jnp.moveaxis(add_up(rows, axis=-1), -1, axis)

    return sums
