"""The functions of a scene with switches, checked, with all that they close over as leaves."""

from typing import Any

import jax
import jax.numpy as jnp

from ..validation.asked import Asked
from ..validation.closures import hides_tracers, method_of
from ..validation.returned import must_have_shape, returned_array
from ..validation.structures import must_be_pair, must_match, outcome
from ..validation.undifferentiated import warn_of_mode_after
from .closures import lifted
from .scene import AbstractScene, State
from .switched import SwitchRules
from .switches import AbstractSwitchedScene, has_switches
from .typed import as_written


def check_mode(scene: Any, mode: Any) -> None:
    """Raise TypeError for a mode that nothing could be done with."""
    if mode is not None and not has_switches(scene):
        raise TypeError(
            f"`mode` must be left out for a {type(scene).__name__}, which has no switches. It is the third argument: "
            "times are given by name, t1=1.0. A scene whose force has modes is a hybridsens.AbstractSwitchedScene."
        )


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
    t, event = jax.ShapeDtypeStruct((), q.dtype), jax.ShapeDtypeStruct((), jnp.asarray(0).dtype)
    asked, kick = Asked.of(scene, "switches(t, q, v, mode)"), Asked.of(scene, "switch(event, t, q, v, mode)")
    switches = must_have_shape(asked, returned_array(asked, t, q, v, mode), ("switch",))
    if jnp.finfo(switches.dtype).bits < jnp.finfo(q.dtype).bits:  # its rounding is what events are told by
        raise TypeError(
            f"`switches` must return {q.dtype}, the type of the state, but returns {switches.dtype}, which is coarser: "
            "give both one type."
        )
    after = outcome(kick, event, t, q, v, mode)
    must_be_pair(kick, after, "(v, mode)")
    must_match(kick, "the velocities", after[0], v, exact=False)
    must_match(kick, "the mode", after[1], mode, exact=True)
    return switches.shape[0]


def switch_rules(scene: AbstractSwitchedScene, t, state: State, mode: Any) -> SwitchRules:
    """Both functions, with every traced value that they close over turned into a leaf."""
    instant = (t, state.q, state.v, mode)
    calls = {"switches": (scene, *instant), "switch": (scene, jnp.asarray(0), *instant)}
    hidden = any(hides_tracers(method_of(name), given) for name, given in calls.items())
    functions = {
        name: lifted(method_of(name), given, state.q.dtype) if hidden else _METHODS[name]
        for name, given in calls.items()
    }
    return SwitchRules(**functions)


def warn_of_switch(rules: SwitchRules, scene: AbstractScene, t, q, v, mode: Any) -> None:
    """Say where the switch writes what is differentiable into the mode."""
    scene = as_written(scene)
    warn_of_mode_after(
        lambda given, *instant: given[0].switch(given[1], *instant), (rules, scene), (jnp.asarray(0), t, q, v, mode),
        f"`switch` of {type(scene).__name__}", "Keep it as the velocity of a coordinate that no force moves.",
    )  # fmt: skip


_METHODS = {name: method_of(name) for name in ("switches", "switch")}
"""One function each for all scenes, so that programs are found again."""
