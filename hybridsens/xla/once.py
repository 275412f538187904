"""Arithmetic that is not to be repeated, and places that are not to be asked for."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array, Bool, Int


def computed_once(true: Bool[Array, ""], function: Callable[[], Any]) -> Any:
    """The result of a function, computed once.

    `true` always holds, which the compiler cannot foresee. Without the conditional, XLA repeats the arithmetic for
    every number that is made from the result."""
    traced, shapes = jax.make_jaxpr(function, return_shape=True)()  # once: to trace it again would take as long
    leaves, tree = jax.tree.flatten(shapes)
    nothing = [jnp.zeros(leaf.shape, leaf.dtype) for leaf in leaves]
    return tree.unflatten(lax.cond(true, jaxpr_as_fun(traced), lambda: nothing))


def unforeseen_zero() -> Int[Array, ""]:
    """0, which the compiler cannot foresee.

    Where it knows that a row is written to the first place of a buffer that was just filled, it makes one loop of both,
    which asks of every entry whether it is of that row: several times as long as to fill the buffer and to write the
    row."""
    return lax.optimization_barrier(jnp.array(0))
