"""A linear map that has a transpose of its own, also in batches and in a program that is differentiated.

It is what `jax.custom_derivatives.linear_call` is, which can neither be batched nor differentiated by what it holds
constant.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive, unmapped_aval
from jax.interpreters import ad, batching, mlir


@dataclasses.dataclass(frozen=True, eq=False)
class LinearMap:
    """Both ways of a map that is linear in its tangents, while constants are held. All are lists of arrays; None stands
    for zero among what a way is given or finds."""

    forward: Callable[[list, list], list]
    """(constants, tangents) -> images."""
    backward: Callable[[list, list], list]
    """(constants, cotangents of the images) -> cotangents of the tangents."""

    def __call__(self, constants: list, tangents: list, types: tuple) -> list:
        """The images of the tangents, which have these types."""
        return _linear_map.bind(*constants, *tangents, way=self, count=len(constants), types=types)

    def of_elements(self, axes: list) -> "LinearMap":
        """That of each element of a batch, where constants have these axes, and all tangents have one."""
        return LinearMap(*(jax.vmap(way, (axes, 0)) for way in (self.forward, self.backward)))


def tangent_types(tree: Any) -> tuple:
    """Types of the tangents of all leaves."""
    return tuple(jax.typeof(leaf).to_tangent_aval() for leaf in jax.tree.leaves(tree))


def _call(*leaves, way: LinearMap, count: int, types):
    found = way.forward(list(leaves[:count]), list(leaves[count:]))
    return [jnp.zeros(t.shape, t.dtype) if x is None else x for x, t in zip(found, types, strict=True)]


_linear_map = Primitive("linear_map")
_linear_map.multiple_results = True
_linear_map.def_impl(_call)
_linear_map.def_abstract_eval(lambda *_, types, **__: types)
mlir.register_lowering(_linear_map, mlir.lower_fun(_call, multiple_results=True))


def _transpose(cotangents, *leaves, way: LinearMap, count: int, types):
    del types
    given = [None if isinstance(cotangent, ad.Zero) else cotangent for cotangent in cotangents]
    found = way.backward(list(leaves[:count]), given)
    nothing = [ad.Zero(undefined.aval) for undefined in leaves[count:]]
    return [None] * count + [zero if x is None else x for x, zero in zip(found, nothing, strict=True)]


ad.primitive_transposes[_linear_map] = _transpose


def _batch(leaves, axes, *, way: LinearMap, count: int, types):
    size = next(leaf.shape[axis] for leaf, axis in zip(leaves, axes, strict=True) if axis is not None)
    moved = [leaf if axis is None else jnp.moveaxis(leaf, axis, 0) for leaf, axis in zip(leaves, axes, strict=True)]
    constants, tangents = moved[:count], moved[count:]
    # Every tangent gets the axis: the transpose of that sums its cotangents over the batch.
    along = zip(tangents, axes[count:], strict=True)
    tangents = [jnp.broadcast_to(d, (size, *d.shape)) if axis is None else d for d, axis in along]
    elements = way.of_elements([None if axis is None else 0 for axis in axes[:count]])
    types = tuple(unmapped_aval(size, 0, one) for one in types)
    return elements(constants, tangents, types), [0] * len(types)


batching.primitive_batchers[_linear_map] = _batch


def _jvp(leaves, tangents, *, way: LinearMap, count: int, types):
    zero = lambda tangent: isinstance(tangent, ad.Zero) or tangent.dtype == jax.dtypes.float0
    given = [None if zero(tangent) else tangent for tangent in tangents]
    fill = lambda of, varied: [jnp.zeros_like(x) if d is None else d for x, d in zip(of, varied, strict=True)]
    constants, along = list(leaves[:count]), leaves[count:]
    if all(tangent is None for tangent in given[:count]):
        return way(constants, list(along), types), way(constants, fill(along, given[count:]), types)
    call = lambda leaves: _call(*leaves, way=way, count=count, types=types)
    out, varied = eqx.filter_jvp(call, (list(leaves),), (given,))
    return out, fill(out, varied)


ad.primitive_jvps[_linear_map] = _jvp
