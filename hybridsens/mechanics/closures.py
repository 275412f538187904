"""Traced values that a scene's functions close over, made visible.

A gradient reaches the array leaves of a scene. A function may also use a traced value that is no leaf of anything,
`lambda scene, t, q, v: w * q[0]` under `jax.grad` by w, say. A custom derivative rule would not see such a value, so
it is
lifted into a leaf first.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.core

from .scene import AbstractScene, State


class LiftedScene(AbstractScene):
    """A scene whose functions' hidden traced values are leaves."""

    scene: AbstractScene
    lifted: dict[str, Callable]

    @property
    def sustained_contact(self):  # type: ignore[override]
        return self.scene.sustained_contact

    def mass_matrix(self, q):
        return self.lifted["mass_matrix"](self.scene, q)

    def force(self, t, q, v):
        return self.lifted["force"](self.scene, t, q, v)

    def gap(self, t, q):
        return self.lifted["gap"](self.scene, t, q)

    def restitution(self):
        return self.lifted["restitution"](self.scene)


class LiftedCost(eqx.Module):
    """A running cost whose hidden traced values are leaves."""

    lifted: Callable

    def __call__(self, scene, t, q, v):
        return self.lifted(scene.scene if isinstance(scene, LiftedScene) else scene, t, q, v)


def lift_closures(scene: AbstractScene, running_cost: Callable | None, t, state: State):
    """The scene and the running cost, with every traced value that they close over turned into a leaf."""
    q, v = state.q, state.v
    calls: dict[str, tuple[Callable, tuple[Any, ...]]] = {
        "mass_matrix": (_method("mass_matrix"), (scene, q)),
        "force": (_method("force"), (scene, t, q, v)),
        "gap": (_method("gap"), (scene, t, q)),
        "restitution": (_method("restitution"), (scene,)),
    }
    if running_cost is not None and _hides_tracers(running_cost, (scene, t, q, v)):
        given_cost = running_cost
        call = lambda *given: given_cost(*given)  # Equinox leaves a function without a closure as it is
        running_cost = LiftedCost(eqx.filter_closure_convert(call, scene, t, q, v))
    if any(_hides_tracers(*call) for call in calls.values()):
        lifted = {name: eqx.filter_closure_convert(function, *given) for name, (function, given) in calls.items()}
        scene = LiftedScene(scene, lifted)
    return scene, running_cost


def _method(name: str) -> Callable:
    """The method of a scene as a function that closes over something: Equinox leaves others as they are."""
    return lambda scene, *given: getattr(scene, name)(*given)


def _hides_tracers(function: Callable, arguments) -> bool:
    """Whether tracing the function meets a traced value that is neither an argument nor a leaf of the function."""
    dynamic, static = eqx.partition((function, arguments), eqx.is_array)

    def call(dynamic):
        function, arguments = eqx.combine(dynamic, static)
        return eqx.filter(function(*arguments), eqx.is_array)

    constants = jax.make_jaxpr(call)(
        jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), dynamic)
    ).consts
    return any(isinstance(constant, jax.core.Tracer) for constant in constants)
