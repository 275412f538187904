"""The backward pass: from the end of a motion to its start, through every jump and every recorded step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..forward.record import Motion, segment, segment_end
from ..xla.packed import pack
from .control import FORESEEN
from .jump import Jump, event_row, pull_jump_back
from .segment_steps import Steps
from .steps_back import BackwardPass, Costate, through_steps


class Gradient(NamedTuple):
    """Derivatives of the cost by everything that a motion is made from."""

    parameters: Any
    x0: Float[Array, "state"]
    t0: Float[Array, ""]
    t1: Float[Array, ""]


def pull_back(
    backward: BackwardPass,
    find_steps: Callable[[Motion, Array], Steps],
    motion: Motion,
    start,
    t1,
    moving_ends: tuple[bool, bool],
) -> Gradient:
    """Gradient of a cost.

    Between events psi is carried back over the recorded steps, psi' = -f_x^T psi, at data times psi- = psi+ + c_x (T7);
    (T8)-(T10) at the events. `find_steps` gives a segment's steps, `start` is (t0, x0); `moving_ends` says whether t0
    and t1 are differentiated by.
    """
    system = eqx.combine(backward.parameters, backward.static)
    events, bar = motion.events, backward.bar
    t1_bar = bar.final @ system.flow(t1, motion.x, motion.mode) if moving_ends[1] else jnp.zeros_like(t1)
    zero = pack(jax.tree.map(jnp.zeros_like, backward.parameters))
    data = jnp.array(0) if backward.ts is None else jnp.sum(backward.ts <= motion.t)
    none = jnp.zeros_like(t1)
    start_of = lambda foreseen, strict, tries: Costate(
        bar.final, none, zero, zero, zero, none, foreseen, strict, data, tries
    )

    def one_segment(carry):
        j, costate = carry
        steps = find_steps(motion, j)
        end = segment_end(motion, j)
        costate = through_steps(backward, steps, end, costate._replace(psi=steps.valid * costate.psi))
        costate = lax.cond(j > 0, lambda: _through_event(backward, events, j - 1, costate), lambda: costate)
        return j - 1, costate

    def sweep(carry):
        number, costate = carry
        foreseen = jax.tree.map(lambda gathered: (FORESEEN * gathered).astype(gathered.dtype), costate.gathered)
        start = (events.count, start_of(foreseen, number > 0, costate.tries))
        return number + 1, lax.while_loop(lambda carry: carry[0] >= 0, one_segment, start)[1]

    def goes_on(carry):
        # How large an error in dJ/dtheta may be is known when all of it is gathered. If it was too large, once more.
        number, costate = carry
        gathered, worst = costate.gathered.unpack(), costate.worst.unpack()
        ratio = backward.control.of_gradient(backward.parameters, gathered, worst, costate.peak)
        unresolved = ratio > 1
        return (number == 0) | ((number == 1) & unresolved)

    _, costate = lax.while_loop(goes_on, sweep, (jnp.array(0), start_of(zero, jnp.array(False), jnp.array(0))))
    lost = jnp.where(costate.tries < backward.control.most_tries, 0, jnp.nan)  # a wrong gradient must not pass
    spoilt = lambda tree: jax.tree.map(lambda leaf: leaf + lost.astype(leaf.dtype), tree)
    costate = costate._replace(psi=spoilt(costate.psi), total=spoilt(costate.total))
    return _through_start(backward, motion, start, costate, t1_bar, moving_ends[0])


def _through_start(backward: BackwardPass, motion: Motion, start, costate: Costate, t1_bar, by_t0: bool) -> Gradient:
    """Adjoint of the beginning, which puts (t0, x0) on the constraints of the mode chosen there."""
    (t0, x0), (mode, _, _) = start, segment(motion, 0)
    system = eqx.combine(backward.parameters, backward.static)
    total, psi, t0_bar = costate.total.unpack(), costate.psi, jnp.zeros_like(t0)
    if by_t0:
        t0_bar = -psi @ system.flow(t0, motion.steps.x[0], mode)
    if system.projects(mode):
        begin = lambda p, t, x: eqx.combine(p, backward.static).project(t, x, mode)
        by_projection, by_t, psi = jax.vjp(begin, backward.parameters, t0, x0)[1](psi)
        total, t0_bar = jax.tree.map(jnp.add, total, by_projection), t0_bar + by_t
    return Gradient(total, psi, t0_bar, t1_bar)


def _through_event(backward: BackwardPass, events, j, costate: Costate) -> Costate:
    """Adjoint jump at event j: psi- = S^T psi+, with what is reported of the event (T8)-(T10)."""
    event, bar = event_row(events, j), backward.bar
    entry = lambda given, rows: jnp.zeros_like(rows[0]) if given is None else given[j]
    reported = (bar.time, bar.before, bar.after, bar.emitted)
    recorded = (events.time, events.before, events.after, events.emitted)
    time, before, after, emitted = jax.tree.map(entry, reported, recorded, is_leaf=lambda leaf: leaf is None)
    cotangent = Jump(costate.psi, time, before, after, emitted)
    total, psi, by_dt = pull_jump_back(backward.parameters, backward.static, event, cotangent, costate.by_dt)
    total = pack(total)
    gathered = jax.tree.map(lambda known, new: known + jnp.abs(new), costate.gathered, total)
    return costate._replace(psi=psi, by_dt=by_dt, total=jax.tree.map(jnp.add, costate.total, total), gathered=gathered)
