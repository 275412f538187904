"""Forward sensitivities: variations of everything recorded, by the recorded steps and the saltation matrices (T6).

They are the derivative rule of the segment loop in forward mode, so `jax.jvp`, `jax.jacfwd` and forward-over-reverse
second derivatives all pass through here.
"""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..forward.explicit import by_mode
from ..forward.record import Motion, segment, write
from ..forward.solver import one_step
from ..forward.tangent import push
from .jump import event_row, push_jump_forward


class Variation(NamedTuple):
    """Variations of what a motion records, each at its own moving time."""

    final: Float[Array, "state"]
    time: Float[Array, "event"]
    before: Float[Array, "event state"]
    after: Float[Array, "event state"]
    emitted: Any
    grid_t: Float[Array, "step"]
    grid_x: Float[Array, "step state"]


def push_forward(parameters, static, solver: diffrax.AbstractSolver, motion: Motion, start, t1, tangents) -> Variation:
    """Variation of a motion under `tangents` of (parameters, x0, t0, t1).

    Inside a segment the grid stands still; its ends move with the events (T5).
    """
    d_parameters, dx0, dt0, dt1 = tangents
    system = eqx.combine(parameters, static)
    t0, x0 = start
    events, steps = motion.events, motion.steps
    mode, _, _ = segment(motion, 0)
    dx = dx0 - system.flow(t0, x0, mode) * dt0
    zeros = lambda tree: jax.tree.map(jnp.zeros_like, tree)
    variation = Variation(
        zeros(motion.x), zeros(events.time), zeros(events.before), zeros(events.after), zeros(events.emitted),
        zeros(steps.t).at[0].set(dt0), zeros(steps.x).at[0].set(dx0),
    )  # fmt: skip

    def one_segment(carry):
        j, dx, variation = carry
        mode, first, last = segment(motion, j)
        dx, grid_x = _through_steps(parameters, static, solver, motion, mode, first, last, d_parameters, dx, variation)
        variation = variation._replace(grid_x=grid_x)
        dx, variation = _through_event(parameters, static, motion, j, last, d_parameters, dx, variation)
        return j + 1, dx, variation

    _, dx, variation = lax.while_loop(
        lambda carry: carry[0] <= events.count, one_segment, (jnp.array(0), dx, variation)
    )
    final = dx + system.flow(t1, motion.x, motion.mode) * dt1
    last = motion.steps.count
    return variation._replace(
        final=final, grid_t=write(variation.grid_t, dt1, last), grid_x=write(variation.grid_x, final, last)
    )


def _through_steps(parameters, static, solver, motion: Motion, mode, first, last, d_parameters, dx, variation):
    t, x = motion.steps.t, motion.steps.x

    def body(carry):
        k, dx, grid_x = carry

        def vary(solver, pick):
            step = lambda p, x0: one_step(solver, pick(eqx.combine(p, static)), mode, t[k], t[k + 1], x0)
            return push(step, k < last, (parameters, x[k]), (d_parameters, dx))[1]

        dx = by_mode(solver, eqx.combine(parameters, static), mode, vary)
        return k + 1, dx, write(grid_x, dx, k + 1)

    _, dx, grid_x = lax.while_loop(lambda carry: carry[0] < last, body, (first, dx, variation.grid_x))
    return dx, grid_x


def _through_event(parameters, static, motion: Motion, j, last, d_parameters, dx, variation: Variation):
    """Saltation at event j: dx+ = S dx- + ..., with the variations of its time and of both of its states.

    After the last segment there is no event: what is computed then is not kept."""
    is_event = j < motion.events.count
    place = jnp.minimum(j, motion.events.time.shape[0] - 1)
    event = event_row(motion.events, place)
    d = push_jump_forward(parameters, static, event, d_parameters, dx, is_event)
    put = lambda buffer, entry: write(buffer, jnp.where(is_event, entry, 0), place)
    variation = Variation(
        variation.final, put(variation.time, d.time), put(variation.before, d.before), put(variation.after, d.after),
        jax.tree.map(put, variation.emitted, d.emitted),
        write(variation.grid_t, d.time, last), write(variation.grid_x, d.after, last),
    )  # fmt: skip
    return jnp.where(is_event, d.state, dx), variation
