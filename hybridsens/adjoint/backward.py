"""The backward pass: from the end of a motion to its start, through every jump and every recorded step."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from ..forward.record import Event, Motion, last_moment, recorded_event, segment, segment_end, where_reached
from ..observables import filled
from ..xla.packed import pack
from .control import FORESEEN
from .jump import Jump, pull_jump_back
from .no_length import pull_no_length
from .steps_back import BackwardPass, BackwardState, through_steps


def pull_back(
    backward: BackwardPass, motion: Motion, initial, t1, perturbed_ends: tuple[bool, bool]
) -> tuple[Any, Array, Array, Array, Array]:
    """Derivatives of a cost by the system, x0, t0 and t1, and whether it ran out of steps.

    Between events psi is carried back over the recorded steps, psi' = -f_x^T psi, at data times psi- = psi+ + c_x
    (T7); at the events (T8)-(T10) hold. Running costs are entries of x. `initial` is (t0, x0); `perturbed_ends`
    says whether t0 and t1 are differentiated by.

    A sweep goes back through all segments. If the error of some step is then too large for the dJ/dtheta just found, a
    second sweep, which cuts such steps, takes its place. Both share `most_tries` steps; out of them, or where steps
    that were run again came back different, all but the derivative by t1 is nan.
    """
    system = backward.system
    t0_perturbed, t1_perturbed = perturbed_ends
    start = _costate_at_end(backward, motion)
    no_gradient = _zeros(eqx.filter(system, eqx.is_inexact_array))

    def one_segment(carry):
        j, at, by_events = carry
        at = _through_segment(backward, motion, j, initial[0], at)
        go = lambda: _through_event(backward, recorded_event(motion, j - 1), j - 1, at, by_events)
        return j - 1, *lax.cond(j > 0, go, lambda: (at, by_events))

    def sweep(carry):
        number, at, _ = carry
        least_scale = jax.tree.map(lambda gathered: (FORESEEN * gathered).astype(gathered.dtype), at.gathered)
        at_end = start._replace(least_scale=least_scale, judges_gradient=number > 0, tries=at.tries)
        begin = motion.events.count, at_end, no_gradient
        _, at, by_events = lax.while_loop(lambda carry: carry[0] >= 0, one_segment, begin)
        return number + 1, at, by_events

    def goes_on(carry):
        # The error allowed to a step is relative to dJ/dtheta, whose size is known after a sweep.
        number, at, _ = carry
        gathered, worst = at.gathered.unpack(), at.worst.unpack()
        too_large = backward.control.of_gradient(backward.step_parameters, gathered, worst, at.peak) > 1
        return (number == 0) | ((number == 1) & too_large)

    _, at, by_events = lax.while_loop(goes_on, sweep, (jnp.array(0), start, no_gradient))
    # Out of tries the gradient is not finished: a wrong one must not pass.
    out_of_steps = at.tries >= backward.control.most_tries
    nan_or_0 = jnp.where(out_of_steps, jnp.nan, 0)
    or_nan = lambda tree: jax.tree.map(lambda leaf: leaf + nan_or_0.astype(leaf.dtype), tree)
    total = _added(or_nan(by_events).unpack(), or_nan(at.total).unpack())
    total, psi, by_t0 = _through_start(backward, motion, initial, total, or_nan(at.psi), t0_perturbed)
    by_t1 = jnp.zeros_like(t1)
    if t1_perturbed:
        flow = system.flow(last_moment(motion, t1), motion.x, motion.mode)
        by_t1 = where_reached(motion, backward.cotangent.final @ flow)
    return total, psi, by_t0, by_t1, out_of_steps


def _through_segment(backward: BackwardPass, motion: Motion, j, t0, at: BackwardState) -> BackwardState:
    """Adjoint of segment j, which lies between events j - 1 and j."""
    steps = backward.find_steps(motion, j)
    at = at._replace(tries=jnp.where(steps.valid, at.tries, backward.control.most_tries))  # no more of them
    at = through_steps(backward, steps, segment_end(motion, j), at)
    # Zeros, which matter to a second derivative alone.
    by_parameters, by_state = pull_no_length(backward.system, backward.step_parameter_mask, motion, j, t0, at.psi)
    total = jax.tree.map(jnp.add, at.total, pack(by_parameters))
    return at._replace(psi=at.psi + by_state, total=total)


def _zeros(tree: Any):
    return pack(jax.tree.map(jnp.zeros_like, tree))


def _costate_at_end(backward: BackwardPass, motion: Motion) -> BackwardState:
    """psi = J_x of the final state; nothing gathered yet.

    Samples that are the final state are met by the first step back, as all others are. An event at the very end leaves
    no step after it: there they are added here."""
    psi, samples_left = backward.cotangent.final, jnp.array(0)
    if backward.ts is not None and backward.cotangent.samples is not None:
        _, first, last = segment(motion, motion.events.count)
        at_end = (first == last) & (backward.ts == motion.t)
        psi = psi + jnp.sum(jnp.where(at_end[:, None], backward.cotangent.samples, 0), axis=0)
        samples_left = jnp.sum((backward.ts <= motion.t) & ~at_end)
    zero, zero_time = _zeros(backward.step_parameters), jnp.zeros_like(motion.t)
    return BackwardState(
        psi=psi, by_dt=zero_time, total=zero, gathered=zero, worst=zero, peak=zero_time,
        least_scale=zero, judges_gradient=jnp.array(False), samples_left=samples_left, tries=jnp.array(0),
    )  # fmt: skip


def _added(by_events: Any, by_steps: Any) -> Any:
    """What events and steps add to dJ/dtheta; a parameter that is in no step is None there."""
    return jax.tree.map(
        lambda of_steps, of_events: of_events if of_steps is None else of_events + of_steps,
        by_steps, by_events, is_leaf=lambda leaf: leaf is None,
    )  # fmt: skip


def _through_start(backward: BackwardPass, motion: Motion, initial, total, psi, t0_perturbed: bool):
    """Adjoint of the beginning, which puts (t0, x0) on the constraints of the mode chosen there: derivatives by the
    system, by x0 and by t0, from dJ/dtheta and psi after it."""
    (t0, x0), (mode, _, _), system = initial, segment(motion, 0), backward.system
    by_t0 = jnp.zeros_like(t0)
    begin = lambda system, t, x: system.project(t, x, mode)
    begun, pull_begin = eqx.filter_vjp(begin, system, t0, x0) if system.projects(mode) else (x0, None)
    if t0_perturbed:
        # From the state at the beginning: the first one recorded is that after an event at t0.
        moves = (motion.t > t0) | motion.ended  # else it never began
        by_t0 = jnp.where(moves, -psi @ system.flow(t0, begun, mode), 0)
    if pull_begin is not None:
        by_projection, by_t, psi = pull_begin(psi)
        total, by_t0 = jax.tree.map(jnp.add, total, by_projection), by_t0 + by_t
    return total, psi, by_t0


def _through_event(backward: BackwardPass, event: Event, j, at: BackwardState, by_events):
    """Adjoint jump at event j: psi- = S^T psi+, with what is reported of the event (T8)-(T10)."""
    reported = filled(event.states, jax.tree.map(lambda rows: rows[j], backward.cotangent.events))
    total, psi, by_dt = pull_jump_back(backward.system, event, Jump(at.psi, reported), at.by_dt)
    # The error of a step is measured against what events add to the same parameters too.
    shared = pack(eqx.filter(total, backward.step_parameter_mask))
    gathered = jax.tree.map(lambda known, new: known + jnp.abs(new), at.gathered, shared)
    by_events = jax.tree.map(jnp.add, by_events, pack(total))
    return at._replace(psi=psi, by_dt=by_dt, gathered=gathered), by_events
