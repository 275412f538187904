"""Batch axes in front of what a function with a derivative rule of its own returns.

JAX (0.10) takes for granted that such a function and its rule leave the axis of a batch in the same place. Where they
do not, `jax.jvp(jax.jit(jax.vmap(f)))` has transposed arrays in the place of the right ones, without a word. So both
put it in front.
"""

from typing import Any

import jax
import jax.core
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

_in_front = Primitive("batch_axis_in_front")
_in_front.def_impl(lambda x: x)
_in_front.def_abstract_eval(lambda x: x)
mlir.register_lowering(_in_front, lambda _, x: [x])
batching.primitive_batchers[_in_front] = lambda given, axes: (_in_front.bind(jnp.moveaxis(given[0], axes[0], 0)), 0)
ad.deflinear2(_in_front, lambda cotangent, x: [cotangent])


def batch_in_front(tree: Any) -> Any:
    """The same tree of arrays; under `jax.vmap` with the axis of the batch in front of every one of them."""
    return jax.tree.map(lambda x: _in_front.bind(x) if isinstance(x, jax.core.Tracer) else x, tree)
