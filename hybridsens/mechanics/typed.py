"""One floating point type for a motion: that of its state.

Leaves of a scene in another type (weights of a network in float32, say) are cast before the motion is computed, and
outside of its derivative rules. So JAX casts their cotangents back, and a gradient comes in each leaf's own type.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..validation.arguments import in_type
from .scene import AbstractScene


class WrappedScene(AbstractScene):
    """A scene around the one that the user wrote."""

    scene: AbstractScene

    @property
    def sustained_contact(self):  # type: ignore[override]
        return self.scene.sustained_contact

    @property
    def known_discontinuities(self):  # type: ignore[override]
        return self.scene.known_discontinuities


def as_written(scene: AbstractScene) -> AbstractScene:
    """The scene that the user wrote: the one that a running cost is given."""
    while isinstance(scene, WrappedScene):
        scene = scene.scene
    return scene


class TypedScene(WrappedScene):
    """A scene whose functions return the type of the state, whatever type theirs is."""

    dtype: Any = eqx.field(static=True)

    def mass_matrix(self, q):
        return in_type(self.scene.mass_matrix(q), q.dtype)

    def force(self, t, q, v):
        return self.scene.force(t, q, v).astype(q.dtype)

    def gap(self, t, q):
        return self.scene.gap(t, q).astype(q.dtype)

    def restitution(self):
        return self.scene.restitution().astype(self.dtype)


class Retyped(eqx.Module):
    """A function whose arrays are kept in one type and handed to it in their own."""

    function: Callable
    types: tuple[Any, ...] = eqx.field(static=True)

    def __call__(self, *given):
        leaves, tree = jax.tree.flatten(self.function)
        own = [leaf if kind is None else leaf.astype(kind) for leaf, kind in zip(leaves, self.types, strict=True)]
        return jax.tree.unflatten(tree, own)(*given)


def retyped(function: Callable, dtype) -> Callable:
    """A function made of arrays, with those of another type kept in this one."""
    types = tuple(leaf.dtype if eqx.is_inexact_array(leaf) else None for leaf in jax.tree.leaves(function))
    return function if {None, jnp.dtype(dtype)} >= set(types) else Retyped(in_type(function, dtype), types)


class Fixed(eqx.Module):
    """A number that a motion depends on and is not differentiated by.

    Every real array of a system is a parameter, and costs the way back a derivative; the bits of one are not real."""

    bits: jax.Array | np.ndarray
    dtype: Any = eqx.field(static=True)

    @staticmethod
    def of(value, dtype) -> "Fixed":
        """The number in that type."""
        dtype = jnp.dtype(dtype)
        bits = jnp.dtype(f"int{8 * dtype.itemsize}")
        if isinstance(value, jax.Array):
            return Fixed(jax.lax.bitcast_convert_type(value.astype(dtype), bits), dtype)
        return Fixed(np.asarray(value, dtype).view(bits), dtype)

    @property
    def number(self) -> jax.Array:
        """The number itself."""
        return jax.lax.bitcast_convert_type(self.bits, self.dtype)


def number(value):
    """What stands for a number, as that number."""
    return value.number if isinstance(value, Fixed) else value
