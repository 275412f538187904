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
from .step_parameters import in_steps
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
    along = _along(backward, in_steps(system, motion.mode, t1, motion.x))
    t1_bar = bar.final @ system.flow(t1, motion.x, motion.mode) if moving_ends[1] else jnp.zeros_like(t1)
    zero, no_jumps = (pack(jax.tree.map(jnp.zeros_like, of.parameters)) for of in (along, backward))
    data = jnp.array(0) if backward.ts is None else jnp.sum(backward.ts <= motion.t)
    none = jnp.zeros_like(t1)
    start_of = lambda foreseen, strict, tries: Costate(
        bar.final, none, zero, zero, zero, none, foreseen, strict, data, tries
    )

    def one_segment(carry):
        j, costate, jumps = carry
        steps = find_steps(motion, j)
        end = segment_end(motion, j)
        costate = through_steps(along, steps, end, costate._replace(psi=steps.valid * costate.psi))
        go = lambda: _through_event(backward, along, events, j - 1, costate, jumps)
        return j - 1, *lax.cond(j > 0, go, lambda: (costate, jumps))

    def sweep(carry):
        number, costate, _ = carry
        foreseen = jax.tree.map(lambda gathered: (FORESEEN * gathered).astype(gathered.dtype), costate.gathered)
        start = (events.count, start_of(foreseen, number > 0, costate.tries), no_jumps)
        return number + 1, *lax.while_loop(lambda carry: carry[0] >= 0, one_segment, start)[1:]

    def goes_on(carry):
        # How large an error in dJ/dtheta may be is known when all of it is gathered. If it was too large, once more.
        number, costate, _ = carry
        gathered, worst = costate.gathered.unpack(), costate.worst.unpack()
        ratio = backward.control.of_gradient(along.parameters, gathered, worst, costate.peak)
        unresolved = ratio > 1
        return (number == 0) | ((number == 1) & unresolved)

    nothing = start_of(zero, jnp.array(False), jnp.array(0))
    _, costate, jumps = lax.while_loop(goes_on, sweep, (jnp.array(0), nothing, no_jumps))
    lost = jnp.where(costate.tries < backward.control.most_tries, 0, jnp.nan)  # a wrong gradient must not pass
    spoilt = lambda tree: jax.tree.map(lambda leaf: leaf + lost.astype(leaf.dtype), tree)
    total = _added(spoilt(jumps).unpack(), spoilt(costate.total).unpack())
    return _through_start(backward, motion, start, Carried(total, spoilt(costate.psi)), t1_bar, moving_ends[0])


class Carried(NamedTuple):
    """What has been carried back to the beginning."""

    total: Any
    """dJ/dtheta so far."""
    psi: Float[Array, "state"]


def _along(backward: BackwardPass, inside: Any) -> BackwardPass:
    """The pass over steps, whose parameters are those `inside` of steps: the others add nothing there, and would cost
    arithmetic in each of them."""
    parameters, others = eqx.partition(backward.parameters, inside)
    return backward._replace(parameters=parameters, static=eqx.combine(others, backward.static))


def _added(jumps: Any, steps: Any) -> Any:
    """What jumps and steps add to dJ/dtheta; a parameter that is in no step is None there."""
    return jax.tree.map(
        lambda of_steps, of_jumps: of_jumps if of_steps is None else of_jumps + of_steps,
        steps, jumps, is_leaf=lambda leaf: leaf is None,
    )  # fmt: skip


def _through_start(backward: BackwardPass, motion: Motion, start, carried: Carried, t1_bar, by_t0: bool) -> Gradient:
    """Adjoint of the beginning, which puts (t0, x0) on the constraints of the mode chosen there."""
    (t0, x0), (mode, _, _) = start, segment(motion, 0)
    system = eqx.combine(backward.parameters, backward.static)
    total, psi, t0_bar = *carried, jnp.zeros_like(t0)
    if by_t0:
        t0_bar = -psi @ system.flow(t0, motion.steps.x[0], mode)
    if system.projects(mode):
        begin = lambda p, t, x: eqx.combine(p, backward.static).project(t, x, mode)
        by_projection, by_t, psi = jax.vjp(begin, backward.parameters, t0, x0)[1](psi)
        total, t0_bar = jax.tree.map(jnp.add, total, by_projection), t0_bar + by_t
    return Gradient(total, psi, t0_bar, t1_bar)


def _through_event(backward: BackwardPass, along: BackwardPass, events, j, costate: Costate, jumps):
    """Adjoint jump at event j: psi- = S^T psi+, with what is reported of the event (T8)-(T10)."""
    event, bar = event_row(events, j), backward.bar
    entry = lambda given, rows: jnp.zeros_like(rows[0]) if given is None else given[j]
    reported = (bar.time, bar.before, bar.after, bar.emitted)
    recorded = (events.time, events.before, events.after, events.emitted)
    time, before, after, emitted = jax.tree.map(entry, reported, recorded, is_leaf=lambda leaf: leaf is None)
    cotangent = Jump(costate.psi, time, before, after, emitted)
    total, psi, by_dt = pull_jump_back(backward.parameters, backward.static, event, cotangent, costate.by_dt)
    of_steps = pack(jax.tree.map(lambda inside, new: None if inside is None else new, along.parameters, total,
                                 is_leaf=lambda leaf: leaf is None))  # fmt: skip
    gathered = jax.tree.map(lambda known, new: known + jnp.abs(new), costate.gathered, of_steps)
    jumps = jax.tree.map(jnp.add, jumps, pack(total))
    return costate._replace(psi=psi, by_dt=by_dt, gathered=gathered), jumps
