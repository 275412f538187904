"""What one writes first: a fixed-step loop whose impacts are a `where`. Its value converges; its gradient does not.

The instant of an impact is a multiple of the step here, so automatic differentiation sees it as a constant:
d t_k = 0 in (T6). What is missing, (R_x f- - f+) dt_k, does not vanish with the step.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..mechanics.contact import contact_geometry, gap_and_rate
from ..mechanics.flow import free_acceleration
from ..mechanics.scene import AbstractScene, State


class NaiveMotion(NamedTuple):
    """End of a motion in fixed steps."""

    final: State
    """State at t1."""
    cost: Any
    """Integral of the running cost by the rectangle rule; None without one."""


def naive_motion(scene: AbstractScene, state: State, *, t1, steps: int, t0=0.0, running_cost=None) -> NaiveMotion:
    """Motion of a scene in `steps` equal steps: semi-implicit Euler, then Newton's law where a gap is negative.

    Contacts are hit one after the other and never stay closed. Differentiable, and wrong, which is its purpose.

    Raises: ValueError if `steps` is below 1.
    """
    if steps < 1:
        raise ValueError(f"`steps` must be >= 1, but is {steps}.")
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

    cost = None
    if running_cost is not None:
        shapes = jax.eval_shape(lambda: running_cost(scene, jnp.zeros_like(dt), state.q, state.v))
        cost = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    (final, cost), _ = lax.scan(step, (state, cost), jnp.arange(steps, dtype=state.q.dtype))
    return NaiveMotion(final, cost)


def _reset_where_closed(scene: AbstractScene, t, q, v):
    """(1.7) for each contact in turn: v+ = v- - (1 + e) Phi'- / W_ii (M^-1 G)_i where Phi_i < 0 and Phi'_i < 0."""
    geometry = contact_geometry(scene, t, q)
    e = scene.restitution()
    for i in range(e.shape[0]):
        gap, rate = gap_and_rate(scene, t, q, v)
        impulse = -(1 + e[i]) * rate[i] / geometry.delassus_matrix[i, i]
        v = jnp.where((gap[i] < 0) & (rate[i] < 0), v + geometry.mobility[:, i] * impulse, v)
    return v
