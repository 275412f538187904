"""How a batch of motions runs: on a CPU one element after the other, elsewhere all elements at once.

A vmapped loop takes as many turns as its slowest element and turns every branch into a selection over all that it
carries. On a CPU a mapped loop does less work, so `jax.vmap` is answered with `lax.map` there.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..numerics.batch_axes import batch_in_front
from .rewriting import rewritten

_ROOM = 256_000_000
"""Bytes that a batch may keep for the way back."""

Choice = Callable[[tuple[bool, ...]], Callable | None]


class Done(NamedTuple):
    """What a function gives that is mapped over a batch."""

    result: Any
    kept: Any = None
    """What a batch keeps too, as long as there is room: zeros stand in its place where there is none."""
    residuals: Any = None
    """What is kept of one motion alone: zeros stand in its place in a batch."""


def map_batch_on_cpu(function: Callable[..., Done], unbatched: Callable[..., Done], choice: Choice | None = None):
    """`function` of PyTrees of arrays; under `jax.vmap` on a CPU, elements are mapped, in batches of batches too.

    `unbatched` replaces it on a CPU where there is no batch. Zeros that stand in the place of what a batch has not kept
    have no batch axis. `choice(batched)` may replace `function` for the elements of a batch; `batched` says for each
    argument whether any of it has a batch axis, so that residuals that were not kept can be told from those that were.
    """
    if jax.default_backend() != "cpu":
        return lambda *given: batch_in_front(function(*given))
    # JAX's own forward rule of a custom batching rule fails when only tangents have a batch axis (an assertion in
    # jax 0.10), so forward mode sees the plain function.
    with_jvp = jax.custom_jvp(_mapped(function, choice, _ROOM, unbatched))
    with_jvp.defjvp(lambda primals, tangents: _jvp_in_front(function, primals, tangents))
    return with_jvp


def _mapped(function, choice: Choice | None, room: int, unbatched=None):
    """`function` of one element, which may be a batch again: every axis is asked on its own, with its own rule."""
    mapped = jax.custom_batching.custom_vmap(unbatched or function)

    @mapped.def_vmap
    def rule(axis_size, in_batched, *arguments):
        leaves, tree = jax.tree.flatten(arguments)
        flags = jax.tree.leaves(in_batched)
        if not any(flags):  # only tangents or cotangents have a batch axis
            out = _mapped(function, choice, room)(*arguments)
            return out, jax.tree.map(lambda _: False, out)
        batched = tuple(any(jax.tree.leaves(flag)) for flag in in_batched)
        chosen = choice(batched) if choice else None
        element = _mapped(chosen, None, room) if chosen else _mapped(function, choice, room // axis_size)
        first = tree.unflatten([leaf[0] if flag else leaf for flag, leaf in zip(flags, leaves, strict=True)])
        shapes = jax.eval_shape(function, *first)
        keeps = axis_size * sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(shapes.kept)) <= room

        def call(elements):
            elements = iter(elements)
            full = tree.unflatten([next(elements) if flag else leaf for flag, leaf in zip(flags, leaves, strict=True)])
            done = element(*full)
            return done.result, done.kept if keeps else None

        result, kept = lax.map(rewritten(call), [leaf for flag, leaf in zip(flags, leaves, strict=True) if flag])
        zeros = lambda tree: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), tree)
        out = Done(result, kept if keeps else zeros(shapes.kept), zeros(shapes.residuals))
        whether = lambda tree, flag: jax.tree.map(lambda _: flag, tree)
        return out, Done(whether(out.result, True), whether(out.kept, keeps), whether(out.residuals, False))

    return mapped


def _jvp_in_front(function, primals, tangents):
    out, tangent = jax.jvp(function, primals, tangents)
    return batch_in_front(out), tangent
