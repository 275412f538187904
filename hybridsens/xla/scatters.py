"""Scatters as loops: XLA makes no kernel of a loop with a scatter in it, and would interpret the whole motion instead.

A force that reads q[indices] is differentiated by a scatter, one that adds up by x.at[indices].add(...) is one itself.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import JaxprEqn

MOST = 2**24
"""Entries of an array that are added to, up to which single precision counts them exactly; a larger one stays."""


def sum_by_scatter(equation: JaxprEqn):
    """A loop in the place of a scatter that adds; None for another equation."""
    if equation.primitive is not lax.scatter_add_p:
        return None
    total: Any = equation.outvars[0].aval
    return partial(_add_one_by_one, equation.params) if total.size < MOST else None


def _add_one_by_one(parameters: dict[str, Any], operand, indices, updates):
    """operand[indices] += updates, one entry after another."""
    scatter = lambda numbers: lax.scatter_add_p.bind(jnp.zeros(operand.shape), indices, numbers, **parameters)
    # Where an update goes is what a scatter's transpose reads there; it reads 0 where an update is dropped.
    places = 1 + jnp.arange(operand.size, dtype=float).reshape(operand.shape)
    (places,) = jax.linear_transpose(scatter, jax.ShapeDtypeStruct(updates.shape, places.dtype))(places)
    places, updates = places.ravel().astype(int), updates.ravel()

    def add(k, total):
        known = lax.dynamic_slice(total, (places[k],), (1,))
        return lax.dynamic_update_slice(total, known + updates[k], (places[k],))

    dropped = jnp.zeros(1, operand.dtype)
    total = lax.fori_loop(0, updates.size, add, jnp.concatenate([dropped, operand.ravel()]))
    return total[1:].reshape(operand.shape)
