"""Reductions of one or two numbers, written out, and arithmetic that is not to be repeated.

XLA sets up buffers for every reduction that it does not compile into a kernel, 0.4 us each at every call. Of more
numbers than two it is left to the library: written out, all that an entry is made from is compiled for each of them.
"""

import functools
import operator
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array, Bool, Float

SHORT = 2


def computed_once(true: Bool[Array, ""], function: Callable[[], Any]) -> Any:
    """The result of a function, computed once.

    The condition is always true, which the compiler cannot foresee. Without it, XLA repeats the arithmetic for every
    number that is made from the result."""
    traced, shapes = jax.make_jaxpr(function, return_shape=True)()  # once: to trace it again would take as long
    leaves, tree = jax.tree.flatten(shapes)
    nothing = [jnp.zeros(leaf.shape, leaf.dtype) for leaf in leaves]
    return tree.unflatten(lax.cond(true, jaxpr_as_fun(traced), lambda: nothing))


def any_of(x: Bool[Array, "n"]) -> Bool[Array, ""]:
    """Whether any entry is true."""
    return _reduced(operator.or_, x) if _is_short(x) else jnp.any(x)


def all_of(x: Bool[Array, "n"]) -> Bool[Array, ""]:
    """Whether every entry is true."""
    return _reduced(operator.and_, x) if _is_short(x) else jnp.all(x)


def smallest(x: Float[Array, "n"]) -> Float[Array, ""]:
    """The smallest entry; inf where there is none."""
    return _reduced(jnp.minimum, x) if _is_short(x) else jnp.min(x, initial=jnp.inf)


def largest(x: Float[Array, "..."]) -> Float[Array, ""]:
    """The largest entry of numbers that are not negative; 0 where there is none."""
    return _reduced(jnp.maximum, x) if _is_short(x) else jnp.max(x, initial=0)


def product(A: Float[Array, "m n"], x: Float[Array, "n"]) -> Float[Array, "m"]:
    """A x. Not for what is differentiated in reverse: its transpose would be a reduction again."""
    if not _is_short(x):
        return A @ x
    return functools.reduce(operator.add, [A[:, k] * x[k] for k in range(x.size)])


def _is_short(x) -> bool:
    return x.ndim == 1 and 0 < x.size <= SHORT


def _reduced(pair, x):
    return functools.reduce(pair, [x[k] for k in range(x.size)])
