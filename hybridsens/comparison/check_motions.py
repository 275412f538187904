"""The motions that a checked cost asked for, with what tells later why a gradient is in doubt."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..discontinuities import system_breaks, that_matter
from ..interval.break_rules import Break
from ..located.system import located as located_system
from ..mechanics.events import Events
from ..mechanics.located import located as located_scene
from ..mechanics.scene import AbstractScene
from ..mechanics.smoothness import scene_breaks
from ..mechanics.switches import in_mode
from ..parameters import FlatParameters
from ..status import Status
from .functional import Cost, move


class BreakFound(NamedTuple):
    """A kink or a jump that a function of the scene or system has, and no event or declared time tells of."""

    function: str
    operation: str
    inputs: str
    """Which of t, q, v or t, x its place depends on, as in "tq"."""


class Call(NamedTuple):
    """One motion that a cost asked for."""

    scene: Any
    """A scene, or a hybrid system."""
    state: Any
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    events: Any
    """`Events` of a scene, `SolutionEvents` of a system."""
    status: Status
    ts: Float[Array, "sample"] | None
    """Times at which states were asked for."""
    jump_ts: Float[Array, "jump"] | None
    """Times of jumps that were declared in the call."""
    breaks: tuple[BreakFound, ...]
    mode: tuple[Any, ...] = ()
    """The initial mode, if one was given."""
    doubt_time: Any = math.nan
    """When its derivatives came into doubt; nan where they are not."""


def value_with_calls(parameters: FlatParameters, cost: Cost, settings) -> Callable:
    """vector -> (J, the motions that it came from), compiled."""

    def value(vector):
        calls = []

        def recording(scene, state, *mode, t0=0.0, t1, ts=None, jump_ts=None, **asked):
            horizon = dict(t0=t0, t1=t1, ts=ts, jump_ts=jump_ts)
            motion = move(scene, state, *mode, **horizon, throw=False, **(settings | asked))
            ts, jump_ts = (None if times is None else jnp.asarray(times) for times in (ts, jump_ts))
            t0, t1 = jnp.asarray(t0), jnp.asarray(t1)
            if asked.get("until") is not None:  # what is looked at is the motion without it, to just behind its end
                t1 = jnp.minimum(t1, motion.end_time + 1e-3 * (motion.end_time - t0))
            breaks = _undeclared_breaks(scene, state, mode, t0, jump_ts, asked.get("running_cost"))
            calls.append(Call(scene, state, t0, t1, motion.events, motion.status, ts, jump_ts, breaks, mode))
            return motion

        return cost(parameters.rebuild(vector), recording), tuple(calls)

    return eqx.filter_jit(value)


def largest_state(calls: tuple[Call, ...]) -> float:
    """The largest entry of the states that motions begin at and come to their events with."""
    states = [leaf for call in calls for leaf in jax.tree.leaves((call.state, call.events.before))]
    return max((float(np.max(np.abs(leaf), initial=0)) for leaf in states), default=0.0)


def on_sequence(value: Callable, nominal: tuple[Call, ...]) -> Callable:
    """J where the motions have the nominal sequence of events, nan where they do not."""

    same = lambda call, known: bool(call.status == Status.successful) and same_sequence(call, known)

    def restricted(vector):
        J, calls = value(jnp.asarray(vector))
        return float(J) if all(map(same, calls, nominal)) else np.nan

    return restricted


def same_sequence(call: Call, known: Call) -> bool:
    """Whether the same events happened in both, in the same order."""
    return all(map(np.array_equal, _which(call), _which(known)))


def _which(call: Call) -> tuple:
    """What tells one sequence of events from another."""
    events = call.events
    return (events.kind, events.contact) if isinstance(events, Events) else (events.guard,)


def _undeclared_breaks(model, state, mode, t0, jump_ts, running_cost) -> tuple[BreakFound, ...]:
    """Kinks and jumps of a scene or a system, without those that are events, and without those in t alone where their
    times are declared."""
    declared = jump_ts is not None or model.jump_times() is not None
    first = mode[0] if mode else None
    if isinstance(model, AbstractScene):
        if model.located_discontinuities:
            model, running_cost, first = located_scene(model, running_cost, t0, state, first)
        scene, running_cost = in_mode(model, running_cost, first)
        found = scene_breaks(scene, t0, state.q, state.v, running_cost)
    else:
        if model.located_discontinuities:
            model, running_cost, _, first = located_system(model, running_cost, 0, (t0, state, first))
        cost_rate = None if running_cost is None else lambda *instant: running_cost(model, *instant)
        found = system_breaks(model, cost_rate, (t0, state, first))
    return tuple(sorted(_break_found(name, b) for name, those in that_matter(found, declared).items() for b in those))


def _break_found(function: str, b: Break) -> BreakFound:
    return BreakFound(function, b.operation, "".join(name for name in "tqvx" if name in b.inputs))
