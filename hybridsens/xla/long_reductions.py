"""Long reductions, cut so that XLA compiles and runs them quickly.

XLA turns a reduction of 32 numbers or more into windows of 32 and what is left of these, and a running sum into as many
windows as it has numbers. A loop over windows takes LLVM a twentieth of a second to compile: a motion of 64 contacts,
which had three hundred of them, compiles in three quarters of the time without. And its numbers are taken one after the
other, where the entries of pieces are taken side by side.
"""

import functools
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import JaxprEqn

from .reductions import PAIRS, is_product_of_vectors

WINDOW = 32
"""So many numbers XLA reduces by windows."""
PIECES, LONG, LONGEST = 8, 128, 2**14
"""More than `LONG` numbers are cut into so many pieces, and these again. All that an entry is made from would be
compiled for each piece then, so it is worked out before. More than `LONGEST` are left to XLA."""
RUNNING = 64
"""The longest running sum that is made by a product with a triangle of ones, which takes n^2 operations."""

add_up = functools.partial(jnp.sum, promote_integers=False)

WHOLE = {
    lax.reduce_sum_p: add_up,
    lax.reduce_max_p: jnp.max,
    lax.reduce_min_p: jnp.min,
    lax.reduce_or_p: jnp.any,
    lax.reduce_and_p: jnp.all,
}


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
    if name not in WHOLE or len(equation.params["axes"]) != 1:
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
    return functools.reduce(PAIRS[name], [WHOLE[name](functools.reduce(PAIRS[name], pieces), axis), *rest])


def _running_sum(x, axis, reverse):
    """Sums of all entries up to each one, or from each one on, as a product. An entry that is infinite makes all of
    them not a number, not only those that hold it."""
    count = x.shape[axis]
    if not jnp.issubdtype(x.dtype, jnp.floating) or not 0 < count <= RUNNING:
        return None
    ones = np.tri(count, dtype=x.dtype)
    product = functools.partial(jnp.tensordot, ones.T if reverse else ones, axes=(1, axis), precision="highest")
    return lambda x: jnp.moveaxis(product(x), 0, axis)
