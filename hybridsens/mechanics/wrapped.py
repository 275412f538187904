"""A scene made ready for its derivative: in one floating point type, and with hidden values as leaves.

The type is that of the state. Leaves of a scene in another type (weights of a network in float32, say) are cast before
the motion is computed, and outside of its derivative rules. So JAX casts their cotangents back, and a gradient comes in
each leaf's own type.

A gradient reaches the array leaves of a scene. A function may also use a traced value that is no leaf of anything,
`lambda scene, t, q, v: w * q[0]` under `jax.grad` by w, say. A custom derivative rule would not see such a value, so
it is lifted into a leaf first.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ..validation.arguments import in_type
from ..validation.lost_derivatives import hides_tracers, method_of
from ..validation.program import digest, traced
from .scene import AbstractScene, State


class WrappedScene(AbstractScene):
    """A scene around the one that the user wrote, whose methods it has unless it says otherwise."""

    scene: AbstractScene

    @property
    def sustained_contact(self):  # type: ignore[override]
        return self.scene.sustained_contact

    @property
    def known_discontinuities(self):  # type: ignore[override]
        return self.scene.known_discontinuities

    def mass_matrix(self, q):
        return self.scene.mass_matrix(q)

    def force(self, t, q, v):
        return self.scene.force(t, q, v)

    def gap(self, t, q):
        return self.scene.gap(t, q)

    def restitution(self):
        return self.scene.restitution()


def as_written(scene: Any) -> Any:
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

    def _load(self, t, q, v):
        return self.scene._load(t, q, v).astype(q.dtype)

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


class LiftedScene(WrappedScene):
    """A scene whose functions' hidden traced values are leaves."""

    lifted: dict[str, Callable]

    def mass_matrix(self, q):
        return self.lifted["mass_matrix"](self.scene, q)

    def force(self, t, q, v):
        return self.lifted["force"](self.scene, t, q, v)

    def gap(self, t, q):
        return self.lifted["gap"](self.scene, t, q)

    def restitution(self):
        return self.lifted["restitution"](self.scene)


def lift_closures(scene: AbstractScene, running_cost: Callable | None, t, state: State, *mode):
    """The scene and the running cost, with every traced value that they close over turned into a leaf; and what names
    the program of their functions.

    The running cost is one of (scene as written, t, q, v, *mode)."""
    q, v = state.q, state.v
    instant = (as_written(scene), t, q, v, *mode)
    calls: dict[str, tuple[Callable, tuple[Any, ...]]] = {
        "mass_matrix": (method_of("mass_matrix"), (scene, q)),
        "force": (method_of("force"), (scene, t, q, v)),
        "gap": (method_of("gap"), (scene, t, q)),
        "restitution": (method_of("restitution"), (scene,)),
    }
    traces = {name: traced(*call) for name, call in calls.items()}
    costs = [] if running_cost is None else [traced(running_cost, instant)]
    if running_cost is not None and any(map(hides_tracers, costs)):
        given_cost = running_cost
        call = lambda *given: given_cost(*given)  # Equinox leaves a function without a closure as it is
        running_cost = lifted(call, instant, q.dtype)
    if any(map(hides_tracers, traces.values())):
        scene = LiftedScene(scene, {name: lifted(*call, q.dtype) for name, call in calls.items()})
    return scene, running_cost, digest([*traces.values(), *costs])


def lifted(function: Callable, arguments, dtype) -> Callable:
    """The function with all that it closes over as leaves, in the type of the state."""
    return retyped(eqx.filter_closure_convert(function, *arguments), dtype)
