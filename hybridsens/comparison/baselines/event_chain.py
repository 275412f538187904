"""A chain of Diffrax solves that end at events, as one writes it without an adjoint for events.

The physics is this package's own (modes, impact law, Gauss's principle). What differs is how a segment's end is found
(by a root finder, at the end of the step, at the right time held constant), and that plain automatic differentiation
goes through all of it.

In all of them `tolerance` is both rtol and atol of the error control, and a motion with more than `max_events` events
is NaN.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Required, TypedDict, Unpack

import diffrax
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import lax
from jaxtyping import Array, Float

from ...forward.solver import TERM
from ...mechanics.decisions import initial_mode
from ...mechanics.events import Events
from ...mechanics.scene import AbstractScene, State
from ...mechanics.system import MechanicalSystem
from .motion import BaselineMotion, flat_problem

MAX_STEPS = 4096
"""Room for the steps of one segment."""
NEWTON = optx.Newton(rtol=1e-10, atol=1e-10)
"""Finds where a guard is zero."""


class Place(NamedTuple):
    """Where a motion stands."""

    t: Float[Array, ""]
    x: Float[Array, "state"]
    mode: Any


SolveSegment = Callable[[MechanicalSystem, Place, Any, float, diffrax.SaveAt], diffrax.Solution]
"""(system, start, t1, tolerance, saveat) -> solution that ended at the first event or at t1."""


class Asked(TypedDict, total=False):
    """What a cost asks of a motion beside its start, as of `hybridsens.simulate`."""

    t0: Any
    t1: Required[Any]
    ts: Any
    running_cost: Any


def first_event(root_finder: optx.AbstractRootFinder | None) -> diffrax.Event:
    """Ends a solve where the smallest guard falls through zero; without a root finder at the end of that step."""

    def smallest_guard(t, y, args, **_):
        system, mode = args
        return jnp.min(system.guards(t, y, mode), initial=jnp.inf)

    return diffrax.Event(smallest_guard, root_finder, direction=False)


def diffrax_solve(system: MechanicalSystem, start: Place, t1, tolerance, saveat, event=None) -> diffrax.Solution:
    """One `diffeqsolve` in a fixed mode."""
    return diffrax.diffeqsolve(
        TERM, diffrax.Tsit5(), start.t, t1, None, start.x, args=(system, start.mode), saveat=saveat, event=event,
        max_steps=MAX_STEPS, stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
    )  # fmt: skip


def event_chain(
    scene: AbstractScene, state: State, asked: Asked, solve_segment: SolveSegment, tolerance: float, max_events: int
) -> BaselineMotion:
    """Motion as `max_events + 1` solves in a row. A motion with more events comes back as NaN."""
    t0, t1, ts, running_cost = asked.get("t0", 0.0), asked["t1"], asked.get("ts"), asked.get("running_cost")
    system, x0, structured = flat_problem(scene, state, t0, running_cost)
    t0, t1 = (jnp.asarray(t, x0.dtype) for t in (t0, t1))
    ts = None if ts is None else jnp.asarray(ts, x0.dtype)
    saveat = diffrax.SaveAt(t1=True, dense=ts is not None)

    def segment(carry, _):
        here, samples = carry
        solution = solve_segment(system, here, t1, tolerance, saveat)
        assert solution.ts is not None and solution.ys is not None
        t, before = solution.ts[-1], solution.ys[-1]
        if ts is not None:
            samples = _fill(samples, ts, here.t, t, t1, solution)
        there, event = pass_event(system, Place(t, before, here.mode), t < t1)
        return (there, samples), event

    start = Place(t0, x0, lax.stop_gradient(initial_mode(scene, t0, state.q, state.v, tolerance)))
    samples = None if ts is None else jnp.zeros((ts.shape[0], x0.shape[0]), x0.dtype)
    (end, samples), rows = lax.scan(segment, (start, samples), length=max_events + 1)
    q, v, z = system.split(jnp.where(end.t >= t1, end.x, jnp.nan))
    q_samples, v_samples = (None, None) if samples is None else system.split(samples)[:2]
    events = Events(**rows, count=jnp.sum(rows["kind"] >= 0))
    return BaselineMotion(State(q, v), structured(z), ts, q_samples, v_samples, events)


def pass_event(system: MechanicalSystem, place: Place, happened) -> tuple[Place, dict[str, Any]]:
    """Reset the state at the contact whose guard is smallest, if the segment ended in an event; and the event's row."""
    t, x, mode = place
    contact = jnp.argmin(system.guards(t, x, mode))
    decision = lax.stop_gradient(system.decide(contact, t, x, mode))
    after, report = system.reset(decision, t, x)
    after = jnp.where(happened, after, x)
    before_q, before_v, _ = system.split(x)
    after_q, after_v, _ = system.split(after)
    row = dict(
        time=jnp.where(happened, t, jnp.inf), kind=jnp.where(happened, decision.kind, -1),
        contact=jnp.where(happened, contact, -1), before=State(before_q, before_v), after=State(after_q, after_v),
        impulse=jnp.where(happened, report.impulse, 0),
        closing_speed=jnp.where(happened, report.closing_speed, 0), order_matters=happened & decision.order_matters,
    )  # fmt: skip
    next_mode = jax.tree.map(lambda new, old: jnp.where(happened, new, old), decision.mode, mode)
    return Place(t, after, next_mode), row


def _fill(samples, ts, t_start, t_end, t1, solution):
    """States at those `ts` that the segment spans, from its dense output."""
    inside = (ts >= t_start) & ((ts < t_end) | (t_end >= t1))
    states = jax.vmap(solution.evaluate)(jnp.clip(ts, t_start, t_end))
    return jnp.where(inside[:, None], states, samples)


def events_at_root(
    scene: AbstractScene, state: State, *, tolerance: float = 1e-8, max_events: int = 64, **asked: Unpack[Asked]
) -> BaselineMotion:
    """Motion whose events are placed by Newton's method on the solver's dense output, and differentiated through it."""
    return event_chain(scene, state, asked, partial(diffrax_solve, event=first_event(NEWTON)), tolerance, max_events)


def events_at_step_end(
    scene: AbstractScene, state: State, *, tolerance: float = 1e-8, max_events: int = 64, **asked: Unpack[Asked]
) -> BaselineMotion:
    """Motion whose events happen at step ends, late by up to a step, and whose times have no derivative: d t_k = 0."""
    return event_chain(scene, state, asked, partial(diffrax_solve, event=first_event(None)), tolerance, max_events)


def constant_event_time(
    scene: AbstractScene, state: State, *, tolerance: float = 1e-8, max_events: int = 64, **asked: Unpack[Asked]
) -> BaselineMotion:
    """Motion whose value is right and whose variations lack (R_x f- + R_t - f+) d t_k of (T6)."""

    def solve(system, start, t1, *settings):
        located = diffrax_solve(system, start, t1, *settings, event=first_event(NEWTON))
        assert located.ts is not None
        return diffrax_solve(system, start, lax.stop_gradient(located.ts[-1]), *settings)

    return event_chain(scene, state, asked, solve, tolerance, max_events)
