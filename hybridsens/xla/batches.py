"""How a batch of motions runs: on a CPU one element after the other, elsewhere all elements at once.

A vmapped loop takes as many turns as its slowest element and turns every branch into a selection over all that it
carries. On a CPU a mapped loop does less work, so `jax.vmap` is answered with `lax.map` there.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from ..numerics.batch_axes import batch_in_front
from .rewriting import rewritten


def map_batch_on_cpu(function: Callable, unbatched: Callable, one_element: Callable | None = None) -> Callable:
    """`function` of PyTrees of arrays returning (result, residuals); under `jax.vmap` on a CPU, elements are mapped.

    `unbatched` replaces it on a CPU where there is no batch. A batch does not keep the residuals of its elements: zeros
    stand in their place, without a batch axis. `one_element(batched, *arguments)` replaces `function` for the elements
    of a batch; `batched` says for each argument whether any of it has a batch axis, so that residuals that were not
    kept can be told from those that were.
    """
    if jax.default_backend() != "cpu":
        return lambda *given: batch_in_front(function(*given))
    mapped = jax.custom_batching.custom_vmap(function)  # an element, which may be a batch again
    by_itself = jax.custom_batching.custom_vmap(unbatched)

    @mapped.def_vmap
    @by_itself.def_vmap
    def rule(axis_size, in_batched, *arguments):
        del axis_size
        leaves, tree = jax.tree.flatten(arguments)
        flags = jax.tree.leaves(in_batched)
        if not any(flags):  # only tangents or cotangents have a batch axis
            out = mapped(*arguments)
            return out, jax.tree.map(lambda _: False, out)
        batched = [any(jax.tree.leaves(flag)) for flag in in_batched]

        def call(elements):
            elements = iter(elements)
            full = tree.unflatten([next(elements) if flag else leaf for flag, leaf in zip(flags, leaves, strict=True)])
            return (mapped(*full) if one_element is None else one_element(batched, *full))[0]

        result = lax.map(rewritten(call), [leaf for flag, leaf in zip(flags, leaves, strict=True) if flag])
        first = tree.unflatten([leaf[0] if flag else leaf for flag, leaf in zip(flags, leaves, strict=True)])
        residuals = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(function, *first)[1])
        out = result, residuals
        return out, (jax.tree.map(lambda _: True, result), jax.tree.map(lambda _: False, residuals))

    # JAX's own forward rule of a custom batching rule fails when only tangents have a batch axis (an assertion in
    # jax 0.10), so forward mode sees the plain function.
    with_jvp = jax.custom_jvp(by_itself)
    with_jvp.defjvp(lambda primals, tangents: _jvp_in_front(function, primals, tangents))
    return with_jvp


def _jvp_in_front(function, primals, tangents):
    out, tangent = jax.jvp(function, primals, tangents)
    return batch_in_front(out), tangent
