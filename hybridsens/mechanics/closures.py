"""Traced values that a scene's functions close over, made visible.

A gradient reaches the array leaves of a scene. A function may also use a traced value that is no leaf of anything,
`lambda scene, t, q, v: w * q[0]` under `jax.grad` by w, say. A custom derivative rule would not see such a value, so
it is lifted into a leaf first.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx

from ..validation.closures import hides_tracers, method_of
from .scene import AbstractScene, State
from .typed import WrappedScene, as_written, retyped


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
    """The scene and the running cost, with every traced value that they close over turned into a leaf.

    The running cost is one of (scene as written, t, q, v, *mode)."""
    q, v = state.q, state.v
    instant = (as_written(scene), t, q, v, *mode)
    calls: dict[str, tuple[Callable, tuple[Any, ...]]] = {
        "mass_matrix": (method_of("mass_matrix"), (scene, q)),
        "force": (method_of("force"), (scene, t, q, v)),
        "gap": (method_of("gap"), (scene, t, q)),
        "restitution": (method_of("restitution"), (scene,)),
    }
    if running_cost is not None and hides_tracers(running_cost, instant):
        given_cost = running_cost
        call = lambda *given: given_cost(*given)  # Equinox leaves a function without a closure as it is
        running_cost = lifted(call, instant, q.dtype)
    if any(hides_tracers(*call) for call in calls.values()):
        scene = LiftedScene(scene, {name: lifted(*call, q.dtype) for name, call in calls.items()})
    return scene, running_cost


def lifted(function: Callable, arguments, dtype) -> Callable:
    """The function with all that it closes over as leaves, in the type of the state."""
    return retyped(eqx.filter_closure_convert(function, *arguments), dtype)
