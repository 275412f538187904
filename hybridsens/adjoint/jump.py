"""Tangents and cotangents across one event: what (T5)-(T10) say, without their algebra.

Seen from a fixed time t_k, a neighbouring motion reaches the guard at t_k + dt. So the map from the state before to the
state after, both at t_k, is: move on by dt with the flow before, reset, move back by dt with the flow after. Its JVP
is the saltation matrix, its VJP the adjoint jump condition, and what is reported of the event gets its derivative from
the same lines.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..flat_system import AbstractFlatSystem
from ..forward.past_jump import past_jump
from ..forward.record import Event, after_jump, before_jump, is_jump, jump_number
from ..observables import EventStates, filled


class Flows(NamedTuple):
    """Flows at an event, each in its own mode: f- and f+."""

    before: Float[Array, "state"]
    after: Float[Array, "state"]


class Jump(NamedTuple):
    """What an event passes on, and what is reported of it."""

    state: Float[Array, "state"]
    """State after, as seen from the fixed time of the recorded event."""
    reported: EventStates


def flows_at(system: AbstractFlatSystem, event: Event) -> Flows:
    """Flows on both sides, held constant while the jump is differentiated."""
    t, at_jump_time = event.states.time, is_jump(event.number)
    before = (jnp.where(at_jump_time, before_jump(t), t), event.states.before, event.mode)
    after = (jnp.where(at_jump_time, after_jump(t), t), event.states.after, event.decision.mode)
    sides = jax.tree.map(lambda *side: jnp.stack(side), before, after)
    return Flows(*lax.map(lambda side: system.flow(*side), sides))  # one copy of the flow to compile


def jump(system: AbstractFlatSystem, event: Event, flows: Flows, before: Float[Array, "state"], dt) -> Jump:
    """From the state before to the state after an event that comes by dt later than recorded:

    x+ = R(t + dt, x- + f- dt) - f+ dt  (T6). Differentiate with respect to `system`, `before` and dt, which is 0.
    """
    t = event.states.time + dt
    at_guard = before + flows.before * dt
    after, emitted = system.reset(event.decision, t, at_guard)
    if system.jump_times() is not None:
        at_jump_time = is_jump(event.number)
        # Of any other event this is not used, and must be finite: so it stays in the mode before.
        beyond = jax.tree.map(lambda old, new: jnp.where(at_jump_time, new, old), event.mode, event.decision.mode)
        after = jnp.where(at_jump_time, past_jump(system, t, at_guard, (event.mode, beyond)), after)
    return Jump(after - flows.after * dt, EventStates(t, at_guard, after, emitted))


def push_jump_forward(system: AbstractFlatSystem, event: Event, d_system, dx, dt_before, is_event=True) -> Jump:
    """Tangent of the jump: dt = -(h_x dx + h_theta dtheta) / h' (T5), and with it dx+ = S dx + ... (T6).

    An event that comes at once moves as the one before, by dt_before, and so does a silent one. Where there is no
    event, h' may be 0: what is returned then is finite and means nothing."""
    t, x, flows = event.states.time, event.states.before, flows_at(system, event)
    guard = lambda system, t, x: fallen_guard(system, event, t, x)
    rate = _tangent(lambda t, x: guard(system, t, x), (t, x), (jnp.ones_like(t), flows.before))
    change = _tangent(guard, (system, t, x), (d_system, None, dx))
    falls = is_event & _falls_by_itself(event)
    dt = jnp.where(_falls_by_itself(event), -change / jnp.where(falls, rate, 1), dt_before)
    go = lambda system, x, dt: jump(system, event, flows, x, dt)
    return _tangent(go, (system, x, jnp.zeros_like(t)), (d_system, dx, dt))


def _tangent(function, primals, tangents):
    """That of what a function returns, with zeros for what does not move."""
    return filled(*eqx.filter_jvp(function, primals, tangents))


class PulledJump(NamedTuple):
    """Cotangents just before an event."""

    total: Any
    """What it adds to dJ/dtheta."""
    psi: Float[Array, "state"]
    by_dt: Float[Array, ""]
    """Of an event that came at once: the derivative by its time, which is that of the event that caused it; else 0."""


def pull_jump_back(
    system: AbstractFlatSystem, event: Event, cotangent: Jump, by_dt_after: Float[Array, ""] | float = 0.0
) -> PulledJump:
    """What the event adds to dJ/dtheta, and psi- = S^T psi+ (T8)-(T9), with what is reported of the event (T10).

    `by_dt_after` is what events that came at once after it hand on."""
    t, x, flows = event.states.time, event.states.before, flows_at(system, event)
    h, pull_guard = eqx.filter_vjp(lambda system, t, x: fallen_guard(system, event, t, x), system, t, x)
    h_theta, h_t, h_x = pull_guard(jnp.ones_like(h))
    go = lambda system, x, dt: jump(system, event, flows, x, dt)
    by_theta, psi, by_dt = eqx.filter_vjp(go, system, x, jnp.zeros_like(t))[1](cotangent)
    by_dt = by_dt + by_dt_after
    falls = _falls_by_itself(event)
    rate = jnp.where(falls, h_t + h_x @ flows.before, 1)
    mu = jnp.where(falls, -by_dt / rate, 0)
    total = jax.tree.map(lambda of_jump, of_guard: of_jump + mu * of_guard, by_theta, h_theta)
    return PulledJump(total, psi + mu * h_x, jnp.where(event.decision.at_once, by_dt, 0))


def _falls_by_itself(event: Event):
    """Whether the time of an event is that at which its guard falls, which another motion reaches earlier or later."""
    return jnp.logical_not(event.decision.silent) & jnp.logical_not(event.decision.at_once)


def fallen_guard(system: AbstractFlatSystem, event: Event, t, x) -> Float[Array, ""]:
    """The guard that fell through zero, h(theta, t, x), in the mode before; t_j(theta, x) - t at a known time t_j.

    Picked by a sum: a system without guards traces through here too, and an index would have no bounds."""
    guards = system.guards(t, x, event.mode)
    fallen = jnp.sum(jnp.where(jnp.arange(guards.shape[0]) == event.number, guards, 0))
    jumps, scheduled = system.jump_times(), system.scheduled_times(x, event.mode)
    if jumps is not None:
        numbers = jump_number(jnp.arange(jumps.shape[0]))
        fallen += jnp.sum(jnp.where(numbers == event.number, jumps - t, 0)).astype(fallen.dtype)
    if scheduled is not None:
        numbers = guards.shape[0] + jnp.arange(scheduled.shape[0])
        fallen += jnp.sum(jnp.where(numbers == event.number, scheduled - t, 0)).astype(fallen.dtype)
    return fallen
