"""Fixed steps with the transition inside a `where`: automatic differentiation holds every event's time constant."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from ...system import AbstractHybridSystem


class SystemMotion(eqx.Module):
    """End of a hybrid system's motion in fixed steps, with the names of a `Solution`."""

    final: Any
    """State at t1."""
    mode: Any
    """Mode at t1."""
    cost: Any
    """Integral of the running cost by the rectangle rule; None without one."""


def where_transition(
    system: AbstractHybridSystem, x0, mode=None, *, t0=0.0, t1, ts=None, running_cost=None, steps: int = 10_000
) -> SystemMotion:
    """Motion in `steps` equal steps of the midpoint rule: (x, mode) = where(guard fell, transition, (x, mode)).

    Guards are looked at one after the other, at the ends of steps. The value converges with the step; what a gradient
    misses, the shift of the events' times, does not vanish.

    Raises: NotImplementedError for states at `ts`, ValueError if `steps` is below 1.
    """
    if steps < 1:
        raise ValueError(f"`steps` must be >= 1, but is {steps}.")
    x0, mode = jax.tree.map(jnp.asarray, (x0, mode))
    if ts is not None:
        raise NotImplementedError("the fixed-step loop keeps no states at `ts`")
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

    cost = None
    if running_cost is not None:
        shapes = jax.eval_shape(lambda: running_cost(system, dt, x0, mode))
        cost = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    (x, mode, cost), _ = lax.scan(step, (x0, mode, cost), jnp.arange(steps, dtype=dt.dtype))
    return SystemMotion(x, mode, cost)


def _watched(system: AbstractHybridSystem, t, x, mode):
    """Guards, and how long it is until each scheduled time."""
    times = system.scheduled_times(x, mode)
    guards = system.guards(t, x, mode)
    return guards if times is None else jnp.concatenate([guards, times - t])


def _switched(system: AbstractHybridSystem, t, before, x, mode):
    """The transition of each guard in turn that was above 0 before the step and is not after it."""

    def turn(event, carry):
        fell = (before[event] > 0) & (_watched(system, t, *carry)[event] <= 0)
        after = system.transition(event, t, *carry)
        return jax.tree.map(lambda new, old: jnp.where(fell, new, old), after, carry)

    return lax.fori_loop(0, before.shape[0], turn, (x, mode)) if before.shape[0] else (x, mode)
