"""What one writes first: a loop of fixed steps whose impacts, or transitions of any hybrid system, are a `where`.

Its value converges; its gradient does not.

The instant of an event is a multiple of the step here, so automatic differentiation sees it as a constant:
d t_k = 0 in (T6). What is missing, (R_x f- - f+) dt_k, does not vanish with the step.
"""

import jax
import jax.numpy as jnp
from jax import lax

from ...mechanics.contact import contact_geometry, gap_and_rate
from ...mechanics.flow import free_acceleration
from ...mechanics.scene import AbstractScene, State
from ...system import AbstractHybridSystem
from .motion import BaselineMotion


def where_reset(
    scene: AbstractScene, state: State, *, t0=0.0, t1, ts=None, running_cost=None, steps: int = 10_000
) -> BaselineMotion:
    """Motion of a scene in `steps` equal steps: semi-implicit Euler, then Newton's law where a gap is negative,
    v+ = where(gap < 0 and closing, reset, v). The running cost is integrated by the rectangle rule.

    Contacts are hit one after the other and never stay closed. Differentiable, and wrong, which is its purpose.

    Raises: NotImplementedError if states at `ts` are asked for, ValueError if `steps` is below 1.
    """
    _must_serve(ts, steps)
    dt = (jnp.asarray(t1, state.q.dtype) - t0) / steps

    def step(carry, k):
        state, cost = carry
        t = t0 + k * dt
        if running_cost is not None:
            rate = running_cost(scene, t, state.q, state.v)
            cost = jax.tree.map(lambda total, part: total + dt * part, cost, rate)
        v = state.v + dt * free_acceleration(scene, t, state.q, state.v)
        q = state.q + dt * v
        return (State(q, _reset_where_closed(scene, t + dt, q, v)), cost), None

    cost = _no_cost(running_cost, scene, dt, state.q, state.v)
    (final, cost), _ = lax.scan(step, (state, cost), jnp.arange(steps, dtype=state.q.dtype))
    return BaselineMotion(final, cost)


def _must_serve(ts, steps: int) -> None:
    """Raise NotImplementedError for states at `ts`, ValueError for less than one step."""
    if ts is not None:
        raise NotImplementedError("the fixed-step loop keeps no states at `ts`")
    if steps < 1:
        raise ValueError(f"`steps` must be >= 1, but is {steps}.")


def _no_cost(running_cost, *instant):
    """Zeros of the structure of a running cost, from which it is added up; None without one."""
    shapes = None if running_cost is None else jax.eval_shape(lambda: running_cost(*instant))
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)


def _reset_where_closed(scene: AbstractScene, t, q, v):
    """(1.7) for each contact in turn: v+ = v- - (1 + e) Phi'- / W_ii (M^-1 G)_i where Phi_i < 0 and Phi'_i < 0."""
    geometry = contact_geometry(scene, t, q)
    e = scene.restitution()
    for i in range(e.shape[0]):
        gap, rate = gap_and_rate(scene, t, q, v)
        impulse = -(1 + e[i]) * rate[i] / geometry.delassus.diagonal()[i]
        v = jnp.where((gap[i] < 0) & (rate[i] < 0), v + geometry.mobility[:, i] * impulse, v)
    return v


def where_transition(
    system: AbstractHybridSystem, x0, mode=None, *, t0=0.0, t1, ts=None, running_cost=None, steps: int = 10_000
) -> BaselineMotion:
    """Motion in `steps` equal steps of the midpoint rule: (x, mode) = where(guard fell, transition, (x, mode)).

    Guards are looked at one after the other, at the ends of steps. The value converges with the step; what a gradient
    misses, the shift of the events' times, does not vanish.

    Raises: NotImplementedError for states at `ts`, ValueError if `steps` is below 1.
    """
    _must_serve(ts, steps)
    x0, mode = jax.tree.map(jnp.asarray, (x0, mode))
    dt = jnp.asarray(t1 - t0, float) / steps
    add = lambda x, rate, h: jax.tree.map(lambda x, r: x + h * r, x, rate)

    def step(carry, k):
        x, mode, cost = carry
        t = t0 + k * dt
        if running_cost is not None:
            cost = add(cost, running_cost(system, t, x, mode), dt)
        middle = add(x, system.flow(t, x, mode), dt / 2)
        moved = add(x, system.flow(t + dt / 2, middle, mode), dt)
        before = _watched(system, t, x, mode)
        return (*_switched(system, t + dt, before, moved, mode), cost), None

    cost = _no_cost(running_cost, system, dt, x0, mode)
    start = _switched(system, t0, _due(system, t0, x0, mode), x0, mode)
    (x, mode, cost), _ = lax.scan(step, (*start, cost), jnp.arange(steps, dtype=dt.dtype))
    return BaselineMotion(x, cost, mode=mode)


def _due(system: AbstractHybridSystem, t0, x, mode):
    """1 for each scheduled time that is t0, and comes there; 0 for all else that is watched."""
    times = system.scheduled_times(x, mode)
    guards = jnp.zeros_like(system.guards(t0, x, mode))
    return guards if times is None else jnp.concatenate([guards, jnp.where(times == t0, 1.0, 0.0)])


def _watched(system: AbstractHybridSystem, t, x, mode):
    """Guards, and how long it is until each scheduled time."""
    times = system.scheduled_times(x, mode)
    guards = system.guards(t, x, mode)
    return guards if times is None else jnp.concatenate([guards, times - t])


def _switched(system: AbstractHybridSystem, t, before, x, mode):
    """The transition of each guard in turn that was above 0 before the step and is not after it, or that a transition
    before it has put below 0: one that this puts at 0, as where a wheel stands after its strike, has not fallen."""
    moved = _watched(system, t, x, mode)

    def turn(event, carry):
        now = _watched(system, t, *carry)[event]
        fell = (before[event] > 0) & jnp.where(moved[event] <= 0, now <= 0, now < 0)
        after = system.transition(event, t, *carry)
        return jax.tree.map(lambda new, old: jnp.where(fell, new, old), after, carry)

    return lax.fori_loop(0, before.shape[0], turn, (x, mode)) if before.shape[0] else (x, mode)
