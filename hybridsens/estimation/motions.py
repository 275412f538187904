"""What a fit asks of a motion, of a mechanical scene or of any other hybrid system."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..adjoint.methods import AbstractGradientMethod
from ..located.system import located
from ..mechanics.mode import EventKind
from ..mechanics.scene import State
from ..mechanics.switches import has_switches
from ..mechanics.trajectory import Trajectory
from ..parameters import flatten_parameters
from ..simulate import simulate
from ..solution import Solution
from ..solve import solve
from ..system import AbstractHybridSystem
from ..system_checks import check_system, mode_as_arrays, state_as_arrays
from ..validation.asked import Asked

FALL = len(EventKind)
"""Kind of an event of a system that is not mechanical: a guard fell, or a scheduled time came."""
KINDS = (*(kind.name.lower() for kind in EventKind), "event")
"""Names of all kinds."""


class FixedSettings(eqx.Module):
    """`Settings` as a part of what is compiled."""

    numbers: tuple[tuple[str, Any], ...] = eqx.field(static=True)
    solver: diffrax.AbstractSolver | None = None

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> "FixedSettings":
        """From `Settings` by name."""
        numbers = tuple(sorted((name, value) for name, value in settings.items() if name != "solver"))
        return cls(numbers, settings.get("solver"))

    def by_name(self) -> dict[str, Any]:
        """As `simulate` takes them."""
        return dict(self.numbers) | {"solver": self.solver}


class Start(eqx.Module):
    """Where motions begin: functions of the scene."""

    state: Callable[..., Any]
    """state(scene) -> State, or x0 of a system."""
    mode: Any = None
    """Initial mode of a system or of a scene with switches, or a function of it."""

    def of(self, scene) -> tuple:
        """What `simulate` or `solve` is given after the scene: a State, or an x0 whose leaves are arrays."""
        general, state = isinstance(scene, AbstractHybridSystem), self.state(scene)
        if not (general or has_switches(scene)):
            return (state,)
        mode = self.mode(scene) if callable(self.mode) else self.mode
        return state_as_arrays(state)[0] if general else state, mode


class EventRows(NamedTuple):
    """Events of a motion, padded with kind -1."""

    time: Float[Array, "event"]
    kind: Int[Array, "event"]
    """An `EventKind`, or `FALL`."""
    contact: Int[Array, "event"]
    """Which contact, or which event of a system."""


def motion_of(scene, start: Start, horizon, ts, settings: FixedSettings, adjoint: AbstractGradientMethod):
    """The motion of a scene or a system over horizon = (t0, t1), with states at ts."""
    t0, t1 = horizon
    times = dict(t0=t0, t1=t1, ts=ts if ts.size else None)
    run: Callable = solve if isinstance(scene, AbstractHybridSystem) else simulate
    return run(scene, *start.of(scene), **times, adjoint=adjoint, throw=False, **settings.by_name())


def samples(motion: Trajectory | Solution) -> tuple:
    """States at the times asked for, as an observation function is given them: (q, v), or (x,)."""
    return (motion.x,) if isinstance(motion, Solution) else (motion.q, motion.v)


def event_rows(motion: Trajectory | Solution) -> EventRows:
    """The events, whatever they are of."""
    if isinstance(motion, Solution):
        guard = motion.events.guard
        return EventRows(motion.events.time, jnp.where(guard >= 0, FALL, -1), guard)
    return EventRows(motion.events.time, motion.events.kind, motion.events.contact)


def strikes(kind: Int[Array, "event"]):
    """Events whose times can be measured: impacts, which are heard, and the events of a system."""
    return (kind == EventKind.IMPACT) | (kind == EventKind.CAPTURE) | (kind == FALL)


def event_count(scene, start: tuple) -> int:
    """How many kinds of events there are whose times can be measured: contacts, or guards, scheduled times and located
    comparisons."""
    if not isinstance(scene, AbstractHybridSystem):
        return eqx.filter_eval_shape(Asked.of(scene, "gap(t, q)"), jnp.zeros(()), start[0].q).shape[0]
    (x, dtype), mode = state_as_arrays(start[0]), mode_as_arrays(start[1])
    t = jnp.zeros((), dtype)
    counts, _ = check_system(scene, None, t, x, mode)
    guards = counts.guards
    if scene.located_discontinuities:
        _, _, guards, _ = located(scene, None, guards, (t, x, mode))
    return guards + (counts.scheduled or 0)


def state_names(start: tuple) -> list[str]:
    """Names that a column of data may have: q0, v0, ... of a scene, or those of the leaves of x."""
    state = start[0]
    if isinstance(state, State):
        return [f"{name}{i}" for name in "qv" for i in range(state.q.shape[0])]
    whole = flatten_parameters({"x": state}).names
    short = [name.removeprefix("x.") for name in whole]
    return short if len(set(short)) == len(short) else list(whole)


def entries(state: tuple) -> Float[Array, "entry"]:
    """The entries of (q, v) or of (x,) in the order of `state_names`."""
    return flatten_parameters(state).vector if len(state) == 1 else jnp.concatenate(state)
