"""Where a motion meets a function whose value is finite and whose derivative is not, as that of a norm at 0."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from ..mechanics.scene import AbstractScene
from ..mechanics.switches import has_switches, in_mode
from .check_motions import Call


def without_derivative(call: Call) -> dict[str, float]:
    """Functions of a scene or a system whose derivative is not finite at the beginning or just after an event: name ->
    the first such instant."""
    times, *after = _instants(call)
    found = {}
    for name, function in _functions(call).items():
        finite = jax.jit(jax.vmap(lambda *instant, asked=function: _is_finite(asked, call.scene, *instant)))
        bad = np.flatnonzero(~np.asarray(finite(times, *after)))
        if bad.size:
            found[name] = float(times[bad[0]])
    return found


def _is_finite(function: Callable, model, *instant):
    """Whether the derivative of function(model, *instant) is, by the parameters and by the instant."""
    dynamic, static = eqx.partition((model, instant), eqx.is_inexact_array)
    vector, restore = ravel_pytree(dynamic)

    def flat(vector):
        model, instant = eqx.combine(restore(vector), static)
        return ravel_pytree(function(model, *instant))[0]

    return jnp.all(jnp.isfinite(jax.jacrev(flat)(vector)))  # by rows: a network has many parameters


def _functions(call: Call) -> dict[str, Callable]:
    """What a motion is made from, by name, as functions of (scene or system, t, state, mode)."""
    if not isinstance(call.scene, AbstractScene):
        return {name: _of_system(name) for name in ("flow", "guards")}
    taken = dict(force="tqv", gap="tq", mass_matrix="q")
    return {name: _of_scene(name, arguments) for name, arguments in taken.items()}


def _of_system(name: str) -> Callable:
    return lambda system, t, x, mode: getattr(system, name)(t, x, mode)


def _of_scene(name: str, arguments: str) -> Callable:
    def function(scene, t, state, mode):
        given = dict(t=t, q=state.q, v=state.v)
        return getattr(in_mode(scene, None, mode)[0], name)(*(given[letter] for letter in arguments))

    return function


def _instants(call: Call) -> tuple[Any, Any, Any]:
    """Times, states and modes of the beginning and just after each event, with a leading axis."""
    count = int(call.events.count)
    before = call.mode[0] if call.mode else None
    modes = not isinstance(call.scene, AbstractScene) or has_switches(call.scene)
    join = lambda first, rows: jnp.concatenate([jnp.asarray(first)[None].astype(rows.dtype), rows[:count]])
    mode = jax.tree.map(join, before, call.events.mode) if modes else None
    return join(call.t0, call.events.time), jax.tree.map(join, call.state, call.events.after), mode
