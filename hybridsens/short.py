"""Reductions of a few numbers, written out.

XLA sets up buffers for every reduction of a program at every call, 0.4 us each, and compiles each by itself; a short
motion takes no longer than a hundred of them. What is longer than `SHORT` goes to the library.
"""

import functools
import operator

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

SHORT = 8


def any_of(x: Bool[Array, "n"]) -> Bool[Array, ""]:
    """Whether any entry is true."""
    return _reduced(operator.or_, x) if _is_short(x) else jnp.any(x)


def all_of(x: Bool[Array, "n"]) -> Bool[Array, ""]:
    """Whether every entry is true."""
    return _reduced(operator.and_, x) if _is_short(x) else jnp.all(x)


def smallest(x: Float[Array, "n"]) -> Float[Array, ""]:
    """The smallest entry; inf where there is none."""
    return _reduced(jnp.minimum, x) if _is_short(x) else jnp.min(x, initial=jnp.inf)


def product(A: Float[Array, "m n"], x: Float[Array, "n"]) -> Float[Array, "m"]:
    """A x. Not for what is differentiated in reverse: its transpose would be a reduction again."""
    if not _is_short(x):
        return A @ x
    return functools.reduce(operator.add, [A[:, k] * x[k] for k in range(x.size)])


def _is_short(x) -> bool:
    return x.ndim == 1 and 0 < x.size <= SHORT


def _reduced(pair, x):
    return functools.reduce(pair, [x[k] for k in range(x.size)])
