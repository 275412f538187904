"""What is gained in no time: nothing, unless its ends move apart.

The derivative of (t1 - t0) w is (dt1 - dt0) w, also where t1 = t0.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from .batch_axes import batch_in_front


@eqx.filter_custom_jvp
def in_no_time(rate: Callable[..., Any], t0, t1, *arguments) -> Any:
    """(t1 - t0) rate(*arguments) for t1 = t0: zeros, for which nothing is computed unless they are differentiated, once
    or more often."""
    shapes = eqx.filter_eval_shape(rate, *arguments)
    zero = _zero((t0, t1, arguments))
    return batch_in_front(jax.tree.map(lambda s: jnp.full(s.shape, zero.astype(s.dtype)), shapes))


def _zero(arguments: Any) -> Array:
    """0, made of everything: under `jax.vmap` it has an axis wherever the derivative has one, as JAX asks of it. The
    compiler sees that it is 0."""
    leaves = [leaf for leaf in jax.tree.leaves(arguments) if eqx.is_inexact_array(leaf) and leaf.size > 0]
    is_number = jnp.stack([jnp.isfinite(leaf[(0,) * leaf.ndim]) for leaf in leaves])
    return jnp.any(is_number & False)


@in_no_time.def_jvp
def _in_no_time_jvp(primals, tangents):
    rate, t0, t1, *arguments = primals
    _, dt0, dt1, *directions = tangents
    apart = (0 if dt1 is None else dt1) - (0 if dt0 is None else dt0)
    zero = _zero((t0, t1, arguments))
    rates = jax.tree.map(lambda leaf: leaf + zero.astype(leaf.dtype), rate(*arguments))
    moved = jax.tree.map(lambda leaf: (apart * leaf).astype(leaf.dtype), rates)
    if jax.tree.leaves(directions):  # (t1 - t0) drate, which matters where this is differentiated again
        change = lambda arguments, directions: _tangent(rate, arguments, directions)
        moved = jax.tree.map(jnp.add, moved, in_no_time(change, t0, t1, arguments, directions))
    return batch_in_front((in_no_time(rate, t0, t1, *arguments), moved))


def _tangent(function: Callable[..., Any], arguments: list, directions: list) -> Any:
    value, tangent = eqx.filter_jvp(function, tuple(arguments), tuple(directions))
    fill = lambda x, d: jnp.zeros_like(x) if d is None else d
    return jax.tree.map(fill, value, tangent)
