"""How a batch of motions runs: on a CPU one element after the other, elsewhere all elements at once.

A vmapped loop takes as many turns as its slowest element and turns every branch into a selection over all that it
carries. On a CPU a mapped loop does less work, so `jax.vmap` is answered with `lax.map` there. JAX's own functions with
a rule for batches (`jax.custom_batching.custom_vmap`) cannot be differentiated where only tangents have a batch axis,
and its custom derivative rules are lost inside of a scan that is differentiated twice: so this is a primitive.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir

from .lockstep import lockstep
from .rewriting import rewritten
from .tracing import collection_put_off

_ROOM = 256_000_000
"""Bytes that a batch may keep for the way back."""

Choice = Callable[[tuple[bool, ...]], Callable | None]


class Done(NamedTuple):
    """What a function gives that is mapped over a batch. Only `result` has a derivative."""

    result: Any
    kept: Any = None
    """What is kept for the way back of an element of a batch: zeros stand in its place where there is no room."""
    residuals: Any = None
    """What is kept where there is no batch: zeros stand in its place in one."""


@dataclasses.dataclass(frozen=True, eq=False)
class Mapped:
    """`function` of PyTrees of arrays. On a CPU the elements of a batch are mapped, in batches of batches too.

    The axes of `jax.vmap` are handled one at a time. Zeros that stand in the place of what a batch has not kept have no
    such axis.
    """

    function: Callable[..., Done]
    unbatched: Callable[..., Done] | None = None
    """Replaces the function where there is no batch."""
    choice: Choice | None = None
    """choice(batched) may replace the function for the elements of an axis; `batched` says for each argument whether
    any of it has that axis, so that residuals that were not kept can be told from those that were."""
    directions: frozenset[int] = frozenset()
    """Arguments that are directions: an axis of theirs alone is not mapped, all of it runs together."""
    vary: Callable[[tuple, Done, tuple], Any] | None = None
    """vary(arguments, done, tangents): how the result varies, if it is known better than by JAX."""
    room: int = _ROOM

    def __call__(self, *arguments) -> Done:
        leaves, tree = jax.tree.flatten(arguments)
        run = self.unbatched or self.function
        with collection_put_off():
            call, shapes = jax.make_jaxpr(lambda *leaves: run(*tree.unflatten(leaves)), return_shape=True)(*leaves)
        out_tree = jax.tree.structure(shapes)
        return out_tree.unflatten(_mapped.bind(*leaves, call=call, mapped=self, tree=tree, out_tree=out_tree))

    def of_elements(self, batched: tuple[bool, ...], axis_size: int) -> "Mapped":
        """What is done with the elements of an axis."""
        chosen = self.choice(batched) if self.choice else None
        room = self.room // max(axis_size, 1)  # a batch may be empty
        narrowed = dataclasses.replace(self, unbatched=None, room=room)
        return dataclasses.replace(narrowed, function=chosen, choice=None) if chosen else narrowed

    def together(self, axes: tuple) -> "Mapped":
        """What is done with an axis whose elements run at once."""
        at_once = lambda function: None if function is None else lockstep(function, axes)
        choice, vary = self.choice, self.vary
        later = None if choice is None else lambda batched: at_once(choice(batched))
        varied = None if vary is None else jax.vmap(vary, (axes, 0, axes))
        return dataclasses.replace(self, function=at_once(self.function), unbatched=None, choice=later, vary=varied)

    def varied(self, count: int) -> "Mapped":
        """How the result varies: the same of one more argument, the tangents of the `count` others."""
        choice, along = self.choice, lambda function: None if function is None else _along(function)
        later = None if choice is None else lambda batched: along(choice(batched[:count]))
        return Mapped(_along(self.function), None, later, self.directions | {count}, room=self.room)


def _along(function: Callable[..., Done]) -> Callable[..., Done]:
    """The derivative of the result along tangents, None for those that are zero."""

    def derivative(*given):
        *arguments, tangents = given
        result = lambda *arguments: function(*arguments).result
        return Done(eqx.filter_jvp(result, tuple(arguments), tangents)[1])

    return derivative


def _call(*leaves, call: ClosedJaxpr, **_):
    return jaxpr_as_fun(call)(*leaves)


_mapped = Primitive("mapped")
_mapped.multiple_results = True
_mapped.def_impl(_call)
_mapped.def_abstract_eval(lambda *_, call, **__: call.out_avals)
mlir.register_lowering(_mapped, mlir.lower_fun(_call, multiple_results=True))


def _batch(leaves, axes, *, call, mapped: Mapped, tree, out_tree):
    del call
    flags = [axis is not None for axis in axes]
    leaves = [leaf if axis is None else jnp.moveaxis(leaf, axis, 0) for leaf, axis in zip(leaves, axes, strict=True)]
    batched = tuple(any(jax.tree.leaves(argument)) for argument in tree.unflatten(flags))
    only_directions = {place for place, flag in enumerate(batched) if flag} <= mapped.directions
    if only_directions or jax.default_backend() != "cpu":
        in_axes = tree.unflatten([0 if flag else None for flag in flags])
        done = mapped.together(in_axes)(*tree.unflatten(leaves))
        return jax.tree.leaves(done), [0] * out_tree.num_leaves
    done, has_axis = _map(mapped, batched, flags, leaves, tree)
    return jax.tree.leaves(done), [0 if flag else None for flag in jax.tree.leaves(has_axis)]


batching.primitive_batchers[_mapped] = _batch


def _map(mapped: Mapped, batched, flags, leaves, tree) -> tuple[Done, Done]:
    """One element after the other; and which leaves have the axis then."""
    given = [leaf for leaf, flag in zip(leaves, flags, strict=True) if flag]
    size = given[0].shape[0]
    element = mapped.of_elements(batched, size)

    def whole(elements):
        elements = iter(elements)
        return tree.unflatten([next(elements) if flag else leaf for leaf, flag in zip(leaves, flags, strict=True)])

    one = [jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype) for leaf in given]  # an empty batch has no first element
    shapes = jax.eval_shape(mapped.function, *whole(one))
    keeps = size * sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(shapes.kept)) <= mapped.room

    def call(elements):
        done = element(*whole(elements))
        return done.result, done.kept if keeps else None

    result, kept = lax.map(rewritten(call), given)
    zeros = lambda tree: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), tree)
    whether = lambda tree, flag: jax.tree.map(lambda _: flag, tree)
    done = Done(result, kept if keeps else zeros(shapes.kept), zeros(shapes.residuals))
    return done, Done(whether(result, True), whether(shapes.kept, keeps), whether(shapes.residuals, False))


def _jvp(leaves, tangents, *, call, mapped: Mapped, tree, out_tree):
    out = _mapped.bind(*leaves, call=call, mapped=mapped, tree=tree, out_tree=out_tree)
    arguments, done = tree.unflatten(leaves), out_tree.unflatten(out)
    zero = lambda tangent: isinstance(tangent, ad.Zero) or tangent.dtype == jax.dtypes.float0
    tangents = tree.unflatten([None if zero(tangent) else tangent for tangent in tangents])
    vary = mapped.vary or (lambda arguments, _, tangents: mapped.varied(len(arguments))(*arguments, tangents).result)
    nothing = jax.tree.map(lambda _: None, done)
    varied = out_tree.flatten_up_to(nothing._replace(result=vary(arguments, done, tangents)))
    no_tangent = lambda value: ad.Zero(jax.typeof(value).to_tangent_aval())
    return out, [no_tangent(value) if d is None else d for value, d in zip(out, varied, strict=True)]


ad.primitive_jvps[_mapped] = _jvp
