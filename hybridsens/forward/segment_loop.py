"""The segment loop: solve a segment, and if it ended in an event decide, jump, write it down, go on."""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..hybrid import AbstractHybridSystem, Decision
from ..precision import time_resolution
from ..status import Status
from .record import Motion
from .segment import SegmentEnd, Stepper, solve_segment


class Transition(NamedTuple):
    """An event carried out."""

    decision: Decision
    after: Float[Array, "state"]
    emitted: Any


def run_segments(system: AbstractHybridSystem, stepper: Stepper, t1, motion: Motion) -> Motion:
    """Carry a motion on to t1, through every event, in one compiled loop (a system without guards: in one solve)."""
    if jax.eval_shape(system.guards, motion.t, motion.x, motion.mode).shape[0] == 0:
        return _run_freely(system, stepper, t1, motion)

    def body(motion):
        motion, end = solve_segment(system, stepper, t1, motion)
        return pass_event(system, motion, end)

    return lax.while_loop(_goes_on, body, motion)


def _goes_on(motion: Motion):
    """Whether the motion is running, and has room for an event (which it always has).

    Two of the values carried are asked, on purpose: where one alone ends a loop, XLA looks for a count of its turns by
    interpreting the body, again at every pass, which took a quarter of the time to compile."""
    return (motion.status == Status.running) & (motion.events.count < motion.events.time.shape[0])


def _run_freely(system: AbstractHybridSystem, stepper: Stepper, t1, motion: Motion) -> Motion:
    begins = system.choose(jnp.array(-1), motion.t, motion.x, motion.mode)
    start = Status.where(motion.status == Status.running, begins.status, motion.status)
    motion = dataclasses.replace(motion, begun=jnp.array(True), status=start)
    motion, _ = solve_segment(system, stepper, jnp.where(start == Status.running, t1, motion.t), motion)
    ended = Status.where(motion.status == Status.running, Status.successful, motion.status)
    return dataclasses.replace(motion, status=Status.where(start == Status.running, ended, start))


def pass_event(system: AbstractHybridSystem, motion: Motion, end: SegmentEnd) -> Motion:
    """Decide what the event is, reset the state, and write the event down; without an event the motion has ended.

    The first event is the beginning: the mode is chosen, nothing jumps, nothing is written down."""
    t, before, events = motion.t, motion.x, motion.events
    full = events.count >= events.time.shape[0] - 1
    again = motion.begun & (end.guard == motion.last_guard) & (t - motion.last_event <= time_resolution(t, 1))
    passes = end.event & ~full & ~again
    jumps = passes & motion.begun

    def transition():
        decision = system.choose(end.guard, t, before, motion.mode)
        after, emitted = system.reset(decision, t, before)
        return Transition(decision, after, emitted)

    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(transition))
    done = lax.cond(passes, transition, lambda: nothing)
    after = jnp.where(jumps, done.after, before)
    hop = jnp.maximum(done.decision.hop, time_resolution(t, 0))  # a step of no length would never grow
    first_step = jnp.where(passes, jnp.minimum(motion.first_step, hop), motion.first_step)
    # The row is written in either case and counts only if the event passed: a buffer that goes through a
    # conditional would be copied whole.
    events = events.append(
        jumps, time=jnp.where(jumps, t, jnp.inf), guard=jnp.where(jumps, end.guard, -1), before=before,
        after=after, emitted=done.emitted, decision=done.decision, mode=motion.mode,
        steps=motion.steps.count, first_step=first_step,
    )  # fmt: skip
    return Motion(
        begun=jnp.array(True),
        t=t,
        x=after,
        mode=jax.tree.map(lambda new, old: jnp.where(passes, new, old), done.decision.mode, motion.mode),
        steps=motion.steps.jump(after),
        events=events,
        last_guard=jnp.where(passes, end.guard, motion.last_guard),
        last_event=jnp.where(jumps, t, motion.last_event),
        grazing=motion.grazing | (jumps & done.decision.grazing),
        rejected=motion.rejected,
        first_step=first_step,
        status=_status(motion, end, full, again, Status.where(passes, done.decision.status, Status.running)),
    )


def _status(motion: Motion, end: SegmentEnd, full, again, decided: Status) -> Status:
    """What is said of the motion after a segment and its event; the earliest cause comes last and wins."""
    reached = Status.where(motion.grazing, Status.grazing, Status.successful)
    ended = Status.where(motion.status == Status.running, reached, motion.status)
    status = Status.where(end.event, motion.status, ended)
    status = Status.where(decided == Status.running, status, decided)
    status = Status.where(end.event & again, Status.contact_stays_closed, status)
    return Status.where(end.event & full, Status.max_events_reached, status)
