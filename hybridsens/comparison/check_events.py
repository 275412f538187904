"""Every event by itself: variations of the piece of motion around it, by three methods, and their determinant."""

import functools
from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..adjoint.methods import ForwardSensitivities, Replay
from ..export.names import contact_names
from ..mechanics.decisions import initial_mode
from ..mechanics.events import Events
from ..mechanics.flow import free_acceleration
from ..mechanics.mode import EventKind
from ..mechanics.scene import State
from ..parameters import flatten_parameters
from ..simulate import simulate
from ..status import Status
from .check_motions import Call
from .differentiate import QUICKLY, best_finite_differences, rounding_of_slopes

MOST = 24
"""How many pieces of a motion are checked."""
OTHER_EVENTS = "not decided: started by itself, this piece has other events"
"""The verdict on an event whose piece of the motion could not be tested."""


class EventCheck(NamedTuple):
    """One event (or several that lie too close to be told apart) and the variations through it."""

    motion: int
    """Which call of `simulate`."""
    events: range
    """Which events of it."""
    time: float
    kind: EventKind
    contact: int
    closing_speed: float
    determinant: float
    """Of d(q, v after)/d(q, v before) by forward sensitivities."""
    expected: float
    """What it must be; nan where that is not known."""
    verdict: str
    """Empty where all agree."""
    contact_name: str = ""
    """The scene's name of the contact, or its number."""

    @property
    def label(self) -> str:
        """Motion and events, as in 0:3 or 0:3-5."""
        first, last = self.events[0], self.events[-1]
        return f"{self.motion}:{first}" + (f"-{last}" if last > first else "")


class Piece(NamedTuple):
    """What one piece of motion does."""

    final: Float[Array, "state"]
    """(q, v) at its end."""
    divergence: Float[Array, ""]
    """int tr f_x dt with every contact open."""
    events: Events
    held: Array
    """Whether a contact is held closed at its start or at its end."""
    status: Status


def check_events(number: int, call: Call, tolerance: float, settings: dict[str, Any]) -> list[EventCheck]:
    """Checks of the first `MOST` pieces of a motion."""
    horizon = float(call.t0), float(call.t1)
    joined = cascades(call.events, np.asarray(call.scene.restitution()))
    groups, times = split_at_events(np.asarray(call.events.time), int(call.events.count), *horizon, joined)
    names, scene_vector, _ = flatten_parameters(call.scene)
    names = (*(f"q[{i}]" for i in range(call.state.q.size)), *(f"v[{i}]" for i in range(call.state.v.size)), *names)
    run = _compile(call.scene, settings | dict(jump_ts=call.jump_ts))
    x = jnp.concatenate([call.state.q, call.state.v])
    checks = []
    for group, t0, t1 in list(zip(groups, times[:-1], times[1:], strict=True))[:MOST]:
        ends = jnp.asarray(t0, x.dtype), jnp.asarray(t1, x.dtype)  # as arrays, so that all pieces share one program
        u = jnp.concatenate([x, scene_vector])
        passage = Passage(run, u, x.size, ends, run.move(u, *ends), names)
        checks.append(_check(number, call, group, passage, tolerance))
        x = passage.piece.final
    return checks


def cascades(events: Events, restitution) -> set[int]:
    """Events that belong to the one before: those from the fastest impact of a cascade on, up to its capture.

    A cascade is cut where it has become slow beside its fastest impact; the last of it, started alone, would go on.
    """
    joined = set()
    contact, speed = np.asarray(events.contact), np.asarray(events.closing_speed)
    for k in range(int(events.count)):
        if events.kind[k] == EventKind.CAPTURE and restitution[contact[k]] > 0:
            own = np.flatnonzero(contact[: k + 1] == contact[k])
            fastest = own[speed[own] >= (1 - 1e-3) * np.max(speed[own])][-1]
            joined |= set(range(fastest + 1, k + 1))
    return joined


def split_at_events(
    time, count: int, t0: float, t1: float, joined: Collection[int] = ()
) -> tuple[list[range], list[float]]:
    """Events in groups, and the times half way between the groups, with t0 and t1 at the ends.

    Events closer than 1e-6 of the horizon stay together: the body must come off the contact before a piece can start.
    So do those in `joined` with the event before them.
    """
    apart = [k for k in range(1, count) if time[k] - time[k - 1] > 1e-6 * (t1 - t0) and k not in joined]
    starts = [0, *apart] if count else []
    groups = [range(a, b) for a, b in zip(starts, [*apart, count], strict=False)] if count else []
    middles = [float(0.5 * (time[k - 1] + time[k])) for k in apart]
    return groups, [t0, *middles, t1] if count else [t0]


class Compiled(NamedTuple):
    """A piece as a function of u = (q, v, parameters), t0 and t1."""

    move: Callable
    forward: Callable
    """d(q, v after)/du by forward sensitivities."""
    reverse: Callable
    """d(w . (q, v after))/du by replay; takes w first."""


def _compile(scene, settings) -> Compiled:
    parameters = flatten_parameters(scene)

    def piece(u, t0, t1, adjoint, running_cost=None):
        dof = (u.size - parameters.vector.size) // 2
        moved, state = parameters.rebuild(u[2 * dof :]), State(u[:dof], u[dof : 2 * dof])
        motion = simulate(
            moved, state, t0=t0, t1=t1, running_cost=running_cost, adjoint=adjoint, throw=False, **settings
        )
        return motion, jnp.any(initial_mode(moved, t0, state.q, state.v, settings["atol"]).active)

    def final(u, t0, t1, adjoint):
        motion, _ = piece(u, t0, t1, adjoint)
        return jnp.concatenate([motion.final.q, motion.final.v])

    def move(u, t0, t1):
        motion, held = piece(u, t0, t1, Replay(), divergence)
        x = jnp.concatenate([motion.final.q, motion.final.v])
        return Piece(x, motion.cost, motion.events, held | jnp.any(motion.mode), motion.status)

    forward = lambda u, t0, t1: jax.jacfwd(lambda u: final(u, t0, t1, ForwardSensitivities()))(u)
    reverse = lambda w, u, t0, t1: jax.grad(lambda u: w @ final(u, t0, t1, Replay()))(u)
    once = functools.partial(jax.jit, compiler_options=QUICKLY)  # for each piece; `move` runs for every difference
    return Compiled(eqx.filter_jit(move), once(forward), once(reverse))


def divergence(scene, t, q, v) -> Float[Array, ""]:
    """tr f_x of the free motion: the trace of d(acceleration)/dv."""
    return jnp.trace(jax.jacfwd(lambda v: free_acceleration(scene, t, q, v))(v))


def expected_determinant(scene, events: Events, held: bool, divergence: float) -> float:
    """det d(q, v)/d(q, v) over a piece: Liouville's exp(int tr f_x dt) times e^2 for each impact.

    An impact's saltation matrix has det R_x = -e, and the guard's rate turns from h' to -e h'. A contact that is held
    takes two directions away: 0. Impacts of several contacts at one instant are not of this kind, nor is a switch, at
    which the force may jump: nan.
    """
    if held:
        return 0.0
    determinant = float(np.exp(divergence))
    for j in range(int(events.count)):
        if events.kind[j] == EventKind.SWITCH:
            return np.nan
        if events.kind[j] == EventKind.IMPACT:
            if np.sum(np.asarray(events.impulse[j]) != 0) != 1:
                return np.nan
            determinant *= float(scene.restitution()[events.contact[j]]) ** 2
    return determinant


class Passage(NamedTuple):
    """One piece, and where it starts."""

    run: Compiled
    u: Float[Array, "entry"]
    """(q, v, parameters) at its start."""
    size: int
    """How many of these are (q, v)."""
    times: tuple[Float[Array, ""], Float[Array, ""]]
    piece: Piece
    names: tuple[str, ...]
    """Of the entries of u."""


def _check(number: int, call: Call, group: range, passage: Passage, tolerance: float) -> EventCheck:
    first, piece = group[0], passage.piece
    known = (np.asarray(getattr(call.events, name))[first] for name in ("time", "kind", "contact", "closing_speed"))
    time, kind, contact, speed = known
    forward = np.asarray(passage.run.forward(passage.u, *passage.times))
    with np.errstate(invalid="ignore"):  # of nan, where a derivative is none
        determinant = float(np.linalg.det(forward[:, : passage.size]))
    held = bool(piece.held) or bool(np.any(np.asarray(piece.events.kind) == EventKind.CAPTURE))
    expected = expected_determinant(call.scene, piece.events, held, float(piece.divergence))
    if _sequence(piece.events) != _sequence(call.events, group):
        verdict = OTHER_EVENTS
    elif not np.isnan(expected) and not abs(determinant - expected) <= tolerance * max(abs(expected), 1):
        verdict = f"determinant must be {expected:.9g}, but is {determinant:.9g}"
    else:
        verdict = _compare_slopes(passage, forward, tolerance)
    names = contact_names(call.scene, call.events.impulse.shape[-1])
    name = str(contact) if kind == EventKind.SWITCH else names[contact]
    return EventCheck(
        number, group, float(time), EventKind(int(kind)), int(contact), float(speed), determinant, expected, verdict,
        name,
    )  # fmt: skip


def _compare_slopes(passage: Passage, forward, tolerance: float) -> str:
    """Slopes of w . (q, v after) for one arbitrary w, by three methods."""
    run, u, size, times, piece, names = passage
    w = np.random.default_rng(0).normal(size=size)
    ours, other = np.asarray(run.reverse(w, u, *times)), w @ forward
    u = np.asarray(u)
    scale = np.where(u != 0, np.abs(u), np.max(np.abs(u[:size]), initial=0) or 1.0)
    sequence = _sequence(piece.events)

    def on_sequence(moved):
        there: Piece = run.move(jnp.asarray(moved), *times)
        same = bool(there.status == Status.successful) and _sequence(there.events) == sequence
        return float(w @ np.asarray(there.final)) if same else np.nan

    found = best_finite_differences(on_sequence, u, scale)
    floor = 1e-3 * np.max(np.abs(ours) * scale) / scale
    limit = tolerance * np.maximum(np.abs(ours), floor)
    apart = [names[i] for i in np.flatnonzero(~(np.abs(ours - other) <= 1e-4 * limit))]
    if apart:
        return f"adjoint and forward sensitivities disagree in {', '.join(apart)}"
    largest = max(np.max(np.abs(x), initial=0) for x in (u[:size], np.asarray(piece.final)))
    rounding = rounding_of_slopes(np.sum(np.abs(w)) * largest, scale, u.dtype)  # of what ends at rest, all there is
    wrong = np.abs(ours - found.slopes) > np.maximum(limit + rounding, 3 * found.uncertainty)  # False without slopes
    apart = [names[i] for i in np.flatnonzero(wrong)]
    return f"differences disagree in {', '.join(apart)}" if apart else ""


def _sequence(events: Events, rows: range | None = None) -> list[tuple[int, int]]:
    rows = range(int(events.count)) if rows is None else rows
    return [(int(events.kind[j]), int(events.contact[j])) for j in rows]
