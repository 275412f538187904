"""What a user writes for a scene with switches of its own: motors, relays, latches, clutches."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float, Int

from ..validation.asked import Asked
from .scene import AbstractScene
from .typed import WrappedScene, as_written


class AbstractSwitchedScene(AbstractScene):
    """A mechanical system whose force has modes of its own, beside those of its contacts.

        M(q) v' = F(t, q, v, mode) + G lambda,   until a contact acts, or a switch falls through 0;
        then  (v, mode) = switch(event, t, q, v, mode)

    Write the methods of `AbstractScene`, `force` with the mode as its last argument, and these two; then
    `simulate(scene, state, mode, t1=...)`. A running cost is given the mode too: `running_cost(scene, t, q, v, mode)`.
    The mode is any PyTree of arrays of fixed shape, and never differentiated.

    The names and rules are those of `AbstractHybridSystem`, with `switches` for its `guards` and `switch` for its
    `transition`: what holds for a guard there, holds for a switch here. Contacts keep their laws, and need no words for
    switches: who is held closed, and by what force, is chosen anew after every switch; who is struck by a body that a
    switch kicked is found as ever. A switch leaves q as it is: two bodies that jump might be inside each other.
    """

    @abc.abstractmethod
    def force(  # type: ignore[override]
        self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"], mode: Any
    ) -> Float[Array, "dof"]:
        """All smooth generalised forces F(t, q, v) in a mode [N, N m]."""

    @abc.abstractmethod
    def switches(
        self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"], mode: Any
    ) -> Float[Array, "switch"]:
        """Functions of a mode, of shape (switch,), smooth in (t, q, v): something switches where one falls to 0."""

    @abc.abstractmethod
    def switch(
        self, event: Int[Array, ""], t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"], mode: Any
    ) -> tuple[Float[Array, "dof"], Any]:
        """Velocities and mode after, of the shapes and types before. `event` says which of `switches` fell."""


class InMode(WrappedScene):
    """A scene with switches as it moves in one mode: a scene like any other."""

    scene: AbstractSwitchedScene  # type: ignore[assignment]
    mode: Any

    def mass_matrix(self, q):
        return Asked.of(self.scene, "mass_matrix(q)")(q)

    def force(self, t, q, v):
        return Asked.of(self.scene, "force(t, q, v, mode)")(t, q, v, self.mode)

    def gap(self, t, q):
        return Asked.of(self.scene, "gap(t, q)")(t, q)

    def restitution(self):
        return Asked.of(self.scene, "restitution()")()


class CostInMode(eqx.Module):
    """A running cost in one mode of a scene with switches."""

    function: Callable[..., Any]
    mode: Any

    def __call__(self, scene, t, q, v):
        return Asked("running_cost(scene, t, q, v, mode)", self.function)(scene, t, q, v, self.mode)


def in_mode(scene: AbstractScene, running_cost: Callable | None, mode: Any) -> tuple[AbstractScene, Callable | None]:
    """A scene and its running cost in a mode, or in another one than before; one without switches as it is."""
    if not has_switches(scene):
        return scene, running_cost
    if isinstance(running_cost, CostInMode):
        running_cost = CostInMode(running_cost.function, mode)
    elif callable(running_cost):
        running_cost = CostInMode(running_cost, mode)
    return _in_mode(scene, mode), running_cost


def has_switches(scene: Any) -> bool:
    """Whether a scene, or the one that it is wrapped around, has switches."""
    return isinstance(as_written(scene), AbstractSwitchedScene)


def _in_mode(scene: Any, mode: Any) -> Any:
    if isinstance(scene, AbstractSwitchedScene):
        return InMode(scene, mode)
    if isinstance(scene, InMode):
        return InMode(scene.scene, mode)
    return dataclasses.replace(scene, scene=_in_mode(scene.scene, mode))
