"""Arithmetic that is not to be repeated."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array, Bool


def computed_once(true: Bool[Array, ""], function: Callable[[], Any]) -> Any:
    """The result of a function, computed once.

    `true` always holds, which the compiler cannot foresee. Without the conditional, XLA repeats the arithmetic for
    every number that is made from the result."""
    traced, shapes = jax.make_jaxpr(function, return_shape=True)()  # once: to trace it again would take as long
    leaves, tree = jax.tree.flatten(shapes)
    nothing = [jnp.zeros(leaf.shape, leaf.dtype) for leaf in leaves]
    return tree.unflatten(lax.cond(true, jaxpr_as_fun(traced), lambda: nothing))
