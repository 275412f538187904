"""The backward pass: from the end of a motion to its start, through every jump and every recorded step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..forward.record import Motion, StepRecord, segment
from .jump import Jump, event_row, pull_jump_back
from .segment_steps import Steps
from .step_adjoint import StepAdjoint


class Cotangents(NamedTuple):
    """Derivatives of the cost by everything that is reported of a motion; None for events where there is none."""

    final: Float[Array, "state"]
    """By the final state."""
    time: Float[Array, "event"] | None
    before: Float[Array, "event state"] | None
    after: Float[Array, "event state"] | None
    emitted: Any
    grid: tuple[Array, Array] | None
    """By the recorded grid times and the states there (samples hang on them); None where nothing does."""


class Gradient(NamedTuple):
    """Derivatives of the cost by everything that a motion is made from."""

    parameters: Any
    x0: Float[Array, "state"]
    t0: Float[Array, ""]
    t1: Float[Array, ""]


def pull_back(
    parameters,
    static,
    carry_back: StepAdjoint,
    find_steps: Callable[[Motion, Array], Steps],
    motion: Motion,
    start,
    t1,
    bar: Cotangents,
    moving_ends: tuple[bool, bool],
) -> Gradient:
    """Gradient of a cost with the cotangents `bar`.

    Between events psi is carried back over the recorded steps, psi' = -f_x^T psi (T7); (T8)-(T10) at the events.
    `parameters` and `static` are the two halves of the system, `find_steps` gives a segment's steps, `start` is
    (t0, x0); `moving_ends` says whether t0 and t1 are differentiated by.
    """
    system = eqx.combine(parameters, static)
    events = motion.events
    t1_grid, final_grid = _grid_bar(bar, motion.steps.count)
    psi = bar.final + final_grid
    t1_bar = t1_grid + (psi @ system.flow(t1, motion.x, motion.mode) if moving_ends[1] else 0)
    total = jax.tree.map(jnp.zeros_like, parameters)

    def one_segment(carry):
        j, psi, total, _ = carry
        mode, steps, first, last, trust = find_steps(motion, j)
        psi = trust * psi
        psi, total = _through_steps(parameters, static, carry_back, steps, mode, first, last, bar, psi, total)
        grid_bar = jax.tree.map(lambda g: jnp.where(last > first, g, 0), _grid_bar(bar, first))
        through = lambda: _through_event(parameters, static, events, j - 1, bar, grid_bar, psi, total)
        psi, total = lax.cond(j > 0, through, lambda: (psi, total))
        return j - 1, psi, total, grid_bar

    zero = jax.tree.map(jnp.zeros_like, (t1_grid, final_grid))
    carry = (events.count, psi, total, zero)
    _, psi, total, (t0_grid, x0_grid) = lax.while_loop(lambda carry: carry[0] >= 0, one_segment, carry)
    t0, x0 = start
    if moving_ends[0]:
        t0_grid = t0_grid - psi @ system.flow(t0, x0, segment(motion, 0)[0])
    return Gradient(total, psi + x0_grid, t0_grid, t1_bar)


def _through_steps(parameters, static, carry_back, steps: StepRecord, mode, first, last, bar: Cotangents, psi, total):
    """Adjoint of the steps first <= k < last of one segment, on their grid."""
    t, x = steps.t, steps.x

    def body(carry):
        k, psi, total = carry
        total_step, psi = carry_back(parameters, static, mode, t[k], t[k + 1], x[k], psi)
        if bar.grid is not None:
            psi = psi + jnp.where(k > first, bar.grid[1][k], 0)
        return k - 1, psi, jax.tree.map(jnp.add, total, total_step)

    _, psi, total = lax.while_loop(lambda carry: carry[0] >= first, body, (last - 1, psi, total))
    return psi, total


def _through_event(parameters, static, events, j, bar: Cotangents, grid_bar, psi, total):
    """Adjoint jump at event j: psi- = S^T psi+, with what is reported of the event (T8)-(T10)."""
    event = event_row(events, j)
    time_grid, after_grid = grid_bar
    entry = lambda given, rows: jnp.zeros_like(rows[0]) if given is None else given[j]
    reported = (bar.time, bar.before, bar.after, bar.emitted)
    recorded = (events.time, events.before, events.after, events.emitted)
    time, before, after, emitted = jax.tree.map(entry, reported, recorded, is_leaf=lambda leaf: leaf is None)
    cotangent = Jump(psi, time + time_grid, before, after + after_grid, emitted)
    total_event, psi = pull_jump_back(parameters, static, event, cotangent)
    return psi, jax.tree.map(jnp.add, total, total_event)


def _grid_bar(bar: Cotangents, k):
    """Cotangents of grid point k: of its time, of its state."""
    if bar.grid is None:
        return jnp.zeros_like(bar.final[0]), jnp.zeros_like(bar.final)
    return bar.grid[0][k], bar.grid[1][k]
