"""How a batch of motions runs: on a CPU one lane after the other, elsewhere all lanes at once.

A vmapped loop takes as many turns as its slowest lane and turns every branch into a selection over all that it
carries. On a CPU a mapped loop does less work, so `jax.vmap` is answered with `lax.map` there.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax


def map_lanes_on_cpu(function: Callable, alone: Callable, one_lane: Callable | None = None) -> Callable:
    """`function` of PyTrees of arrays returning (result, scratch); under `jax.vmap` on a CPU, lanes are mapped.

    `alone` replaces it on a CPU where there is no batch. A batch does not keep the scratch of its lanes: zeros stand in
    its place, without a batch axis. `one_lane(batched, *arguments)` replaces `function` for the lanes of a batch;
    `batched` says for each argument whether any of it has a batch axis, so that a scratch that was not kept can be told
    from one that was.
    """
    if jax.default_backend() != "cpu":
        return function
    mapped = jax.custom_batching.custom_vmap(function)  # a lane, which may be a batch again
    by_itself = jax.custom_batching.custom_vmap(alone)

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

        def call(lanes):
            lanes = iter(lanes)
            full = tree.unflatten([next(lanes) if flag else leaf for flag, leaf in zip(flags, leaves, strict=True)])
            return (mapped(*full) if one_lane is None else one_lane(batched, *full))[0]

        result = lax.map(call, [leaf for flag, leaf in zip(flags, leaves, strict=True) if flag])
        first = tree.unflatten([leaf[0] if flag else leaf for flag, leaf in zip(flags, leaves, strict=True)])
        scratch = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(function, *first)[1])
        out = result, scratch
        return out, (jax.tree.map(lambda _: True, result), jax.tree.map(lambda _: False, scratch))

    # JAX's own forward rule of a custom batching rule fails when only tangents have a batch axis (an assertion in
    # jax 0.10), so forward mode sees the plain function.
    with_jvp = jax.custom_jvp(by_itself)
    with_jvp.defjvp(lambda primals, tangents: jax.jvp(function, primals, tangents))
    return with_jvp
