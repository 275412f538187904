"""A scene with switches of its own (motors, relays, latches, clutches): what a user writes, and what it must be."""

import abc
import dataclasses
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..export.names import check_switch_names
from ..validation.asked import Asked
from ..validation.lost_derivatives import hides_tracers, method_of, warn_of_mode_after
from ..validation.own_start import check_mode_given
from ..validation.program import digest, traced
from ..validation.returned import must_have_shape, returned_array
from ..validation.transition import check_change
from .scene import AbstractScene, State
from .wrapped import WrappedScene, as_written, lifted


class AbstractSwitchedScene(AbstractScene):
    """A mechanical system whose force has modes of its own, beside those of its contacts.

        M(q) v' = F(t, q, v, mode) + G lambda,   until a contact acts, or a switch falls through 0;
        then  (v, mode) = switch(event, t, q, v, mode)

    Write the methods of `AbstractScene`, `force` with the mode as its last argument, and these two; then
    `simulate(scene, state, mode, t1=...)`. A running cost is given the mode too: `running_cost(scene, t, q, v, mode)`.
    The mode is any PyTree of arrays of fixed shape, and never differentiated.

    The names and rules are those of `AbstractHybridSystem`, with `switches` for its `guards` and `switch` for its
    `transition`: what holds for a guard there, holds for a switch here. Contacts keep their laws, and need no words for
    switches: which are held closed, and by what force, is chosen anew after every switch; what a body strikes that a
    switch kicked is found as ever. A switch leaves q as it is: two bodies that jump might be inside each other.
    """

    event_names: ClassVar[tuple[str, ...] | None] = None
    """Names of the switches, ("burnout",): for tables and pictures."""

    @abc.abstractmethod
    def force(  # type: ignore[override]
        self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"], mode: Any
    ) -> Float[Array, "dof"]:
        """All smooth generalised forces F(t, q, v) in a mode [N, N m]."""

    @abc.abstractmethod
    def switches(
        self, t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"], mode: Any
    ) -> Float[Array, "switch"]:
        """Functions of a mode, of shape (switch,), smooth in (t, q, v): it switches where one falls through 0."""

    @abc.abstractmethod
    def switch(
        self, event: Int[Array, ""], t: Float[Array, ""], q: Float[Array, "dof"], v: Float[Array, "dof"], mode: Any
    ) -> tuple[Float[Array, "dof"], Any]:
        """Velocities and mode after, of the shapes and types before. `event` says which of `switches` fell."""

    def _gap_in(self, t, q, mode: Any) -> Float[Array, "contact"]:
        """Gaps in a mode: those of every mode, unless their comparisons are held."""
        del mode
        return Asked.of(self, "gap(t, q)")(t, q)

    def _at_rest(self, event: Int[Array, ""], t, q, v, mode: Any, on_zero: Bool[Array, "switch"]) -> Any:
        """The mode after an event that has left some of `switches` on zero, where they stay, but for that number; None
        for a scene whose mode changes by `switch` alone."""
        del event, t, q, v, mode, on_zero


class InMode(WrappedScene):
    """A scene with switches as it moves in one mode: a scene like any other."""

    scene: AbstractSwitchedScene  # type: ignore[assignment]
    mode: Any

    def mass_matrix(self, q):
        return Asked.of(self.scene, "mass_matrix(q)")(q)

    def force(self, t, q, v):
        return Asked.of(self.scene, "force(t, q, v, mode)")(t, q, v, self.mode)

    def gap(self, t, q):
        return self.scene._gap_in(t, q, self.mode)

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


def check_mode(scene: Any, mode: Any) -> None:
    """Raise TypeError for a mode that nothing could be done with."""
    if mode is not None and not has_switches(scene):
        raise TypeError(
            f"`mode` must be left out for a {type(scene).__name__}, which has no switches. It is the third argument: "
            "times are given by name, t1=1.0. A scene whose force has modes is a hybridsens.AbstractSwitchedScene."
        )
    if has_switches(scene):
        check_mode_given(as_written(scene), mode, "scene")


def check_switches(scene: AbstractSwitchedScene, state: State, mode: Any) -> int:
    """How many switches there are.

    Raises: ValueError or TypeError where the scene's functions do not fit the state or the mode."""
    try:
        return _count_switches(scene, state, mode)
    except Exception as error:
        if mode is None:
            error.add_note("No `mode` was given to begin in.")
        raise


def _count_switches(scene: AbstractSwitchedScene, state: State, mode: Any) -> int:
    described = lambda tree: jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), tree)
    q, v, mode = described((state.q, state.v, mode))
    t, asked = jax.ShapeDtypeStruct((), q.dtype), Asked.of(scene, "switches(t, q, v, mode)")
    switches = must_have_shape(asked, returned_array(asked, t, q, v, mode), ("switch",))
    if jnp.finfo(switches.dtype).bits < jnp.finfo(q.dtype).bits:  # its rounding is what events are told by
        raise TypeError(
            f"`switches` must return {q.dtype}, the type of the state, but returns {switches.dtype}, which is coarser: "
            "give both one type."
        )
    check_switch_names(scene, switches.shape[0])
    kick = Asked.of(scene, "switch(event, t, q, v, mode)")
    check_change(kick, "(v, mode)", "the velocities", v, (t, q, v, mode))
    return switches.shape[0]


class SwitchRules(eqx.Module):
    """The two functions that a scene with switches has beside those of any scene."""

    switches: Callable[..., Any]
    """(scene, t, q, v, mode) -> (switch,)"""
    switch: Callable[..., Any]
    """(scene, event, t, q, v, mode) -> (v, mode)"""


def switch_rules(scene: AbstractSwitchedScene, t, state: State, mode: Any) -> tuple[SwitchRules, str]:
    """Both functions, with every traced value that they close over turned into a leaf; and what names their program."""
    instant = (t, state.q, state.v, mode)
    calls = {"switches": (scene, *instant), "switch": (scene, jnp.asarray(0), *instant)}
    traces = [traced(method_of(name), given) for name, given in calls.items()]
    hidden = any(map(hides_tracers, traces))
    functions = {
        name: lifted(method_of(name), given, state.q.dtype) if hidden else _METHODS[name]
        for name, given in calls.items()
    }
    return SwitchRules(**functions), digest(traces)


def warn_of_switch(rules: SwitchRules, scene: AbstractScene, t, q, v, mode: Any) -> None:
    """Say where the switch writes what is differentiable into the mode."""
    scene = as_written(scene)
    warn_of_mode_after(
        lambda given, *instant: given[0].switch(given[1], *instant), (rules, scene), (jnp.asarray(0), t, q, v, mode),
        f"`switch` of {type(scene).__name__}", "Keep it as the velocity of a coordinate that no force moves.",
    )  # fmt: skip


_METHODS = {name: method_of(name) for name in ("switches", "switch")}
"""One function each for all scenes, so that programs are found again."""
