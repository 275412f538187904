"""Forward sensitivities: tangents of everything recorded, by the recorded steps and the saltation matrices (T6).

They are the derivative rule of the segment loop in forward mode, so `jax.jvp`, `jax.jacfwd` and forward-over-reverse
second derivatives all pass through here.
"""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import AbstractFlatSystem
from ..forward.explicit import by_mode
from ..forward.record import (
    Motion,
    StepRecord,
    after_jump,
    is_jump,
    last_moment,
    recorded_event,
    segment,
    segment_end,
    where_reached,
    write,
)
from ..forward.solver import step_with_error
from ..forward.tangent import push
from ..numerics.tolerances import time_resolution
from ..observables import EventStates
from ..xla.once import unforeseen_zero
from .control import DerivativeControl, of_all_directions
from .jump import push_jump_forward
from .no_length import push_no_length


class MotionTangent(NamedTuple):
    """Tangents of what a motion records, each at its own moving time."""

    end: Float[Array, ""]
    """Of the time at which it ends."""
    final: Float[Array, "state"]
    events: EventStates
    steps_t: Float[Array, "step"]
    steps_x: Float[Array, "step state"]


class ForwardPass(NamedTuple):
    """What the push-forward is made from; constant while it runs."""

    system: AbstractFlatSystem
    d_system: Any
    """Its tangent: a number for every parameter."""
    solver: diffrax.AbstractSolver
    control: DerivativeControl


class Pushed(NamedTuple):
    """Where the push-forward stands between two segments."""

    dx: Float[Array, "state"]
    dt: Float[Array, ""]
    """Tangent of the time of the last event."""
    steps: StepRecord
    """The steps taken so far: the recorded ones, and those that they were cut into."""
    ends: Int[Array, "event"]
    """How many of them came before each event."""
    tangent: MotionTangent
    """As far as it has come."""
    peak: Float[Array, ""]
    """The largest size that dx had."""
    tries: Int[Array, ""]
    """Steps tried."""


class ForwardPlace(NamedTuple):
    """Where the push-forward stands inside of a segment."""

    k: Int[Array, ""]
    """The recorded step."""
    t: Float[Array, ""]
    x: Float[Array, "state"]
    dx: Float[Array, "state"]
    width: Float[Array, ""]
    """Longest step to try; inf for as long as the recorded one."""
    steps: StepRecord
    steps_t: Float[Array, "step"]
    """Tangents of their times."""
    steps_x: Float[Array, "step state"]
    """Those of their states."""
    peak: Float[Array, ""]
    tries: Int[Array, ""]


def push_forward(
    forward: ForwardPass, motion: Motion, initial, t1, tangents
) -> tuple[Motion, MotionTangent, Bool[Array, ""]]:
    """The motion with all steps that its tangent has taken, that tangent, under `tangents` of (x0, t0, t1), and whether
    there was no room for all of its steps: then it is nan.

    `initial` is (t0, x0). The tangent dx is that at fixed times. What is recorded moves: events by (T5), and the steps
    of a segment with the event that it begins with, so that they keep their lengths. Were they to stand still, a second
    derivative would gather what the error of the first step changes by, times how far that event moves: the later it
    comes, the farther.
    """
    dx0, dt0, dt1 = tangents
    dt1 = where_reached(motion, dt1)
    pushed = _start(forward, motion, initial, (dx0, dt0, dt1))

    def one_segment(carry):
        j, pushed = carry
        return j + 1, _through_segment(forward, motion, j, initial[0], pushed)

    goes_on = lambda carry: carry[0] <= motion.events.count
    _, pushed = lax.while_loop(goes_on, one_segment, (jnp.array(0), pushed))
    room = motion.steps.t.shape[0] - 2  # as `empty_steps` has it
    resolved = (pushed.tries < forward.control.most_tries) & (pushed.steps.count <= room)
    dx = jnp.where(resolved, pushed.dx, jnp.nan)
    final = dx + forward.system.flow(last_moment(motion, t1), motion.x, motion.mode) * dt1
    tangent, last = pushed.tangent, pushed.steps.count
    tangent = tangent._replace(
        final=final, steps_t=write(tangent.steps_t, dt1, last), steps_x=write(tangent.steps_x, final, last)
    )
    motion = eqx.tree_at(lambda m: (m.steps, m.events.steps), motion, (pushed.steps, pushed.ends))
    return motion, tangent, ~resolved


def _start(forward: ForwardPass, motion: Motion, initial, tangents) -> Pushed:
    """The tangent of the beginning, which puts (t0, x0) on the constraints of the mode chosen there."""
    (t0, x0), (dx0, dt0, dt1) = initial, tangents
    system, d_system = forward.system, forward.d_system
    events, steps = motion.events, motion.steps
    mode, _, _ = segment(motion, 0)
    begin = lambda system, t, x: system.project(t, x, mode)
    x0, dx0 = eqx.filter_jvp(begin, (system, t0, x0), (d_system, dt0, dx0))
    moves = (motion.t > t0) | motion.ended  # else it never began
    dx = dx0 - jnp.where(moves, system.flow(t0, x0, mode) * dt0, 0)
    zeros, first = lambda tree: jax.tree.map(jnp.zeros_like, tree), unforeseen_zero()
    tangent = MotionTangent(
        dt1, zeros(motion.x), zeros(events.states), write(zeros(steps.t), dt0, first), write(zeros(steps.x), dx0, first)
    )
    later = jnp.full_like(steps.t, jnp.inf)
    taken = StepRecord(write(later, steps.t[0], first), write(zeros(steps.x), steps.x[0], first), jnp.array(0))
    peak = forward.control.of_direction(eqx.filter(system, eqx.is_inexact_array), d_system, x0, dx0).astype(t0.dtype)
    return Pushed(dx, dt0, taken, zeros(events.steps), tangent, peak, jnp.array(0))


def _through_segment(forward: ForwardPass, motion: Motion, j, t0, pushed: Pushed) -> Pushed:
    """Through the steps of segment j, and the event that ends it."""
    steps, tangent = motion.steps, pushed.tangent
    _, first, _ = segment(motion, j)
    unlimited = jnp.full_like(t0, jnp.inf)
    at = ForwardPlace(
        first, steps.t[first], steps.x[first], pushed.dx, unlimited, pushed.steps, tangent.steps_t, tangent.steps_x,
        pushed.peak, pushed.tries,
    )  # fmt: skip
    at = _through_steps(forward, motion, j, at, pushed.dt)
    # What is added is zero, and matters to a second derivative alone.
    dx = at.dx + push_no_length(forward.system, forward.d_system, motion, j, t0, at.dx)
    moves, tangent = (dx, pushed.dt), tangent._replace(steps_t=at.steps_t, steps_x=at.steps_x)
    dx, dt, taken, tangent = _through_event(forward, motion, j, moves, at.steps, tangent)
    here = jnp.minimum(j, pushed.ends.shape[0] - 1)
    ends = write(pushed.ends, jnp.where(j < motion.events.count, taken.count, 0), here)
    return Pushed(dx, dt, taken, ends, tangent, at.peak, at.tries)


def _through_steps(forward: ForwardPass, motion: Motion, j, start: ForwardPlace, dt) -> ForwardPlace:
    """Tangents through the steps of segment j: each recorded step at once, or in as many as they need. The segment
    begins by dt later."""
    control, record = forward.control, motion.steps
    mode, _, last = segment(motion, j)
    end = segment_end(motion, j)

    def body(place: ForwardPlace) -> ForwardPlace:
        step_end = jnp.where(place.k + 1 < last, record.t[place.k + 1], end)
        reaches = step_end - place.t <= place.width
        t1 = jnp.where(reaches, step_end, place.t + control.cut(place.width))
        (x1, _), (dx1, d_error) = _push_step(forward, mode, place, t1)
        ratio, size = control.of_state(place.x, place.dx, dx1, d_error, place.peak, place.tries)
        accepted, width = control.judge(of_all_directions(ratio), t1 - place.t, place.width)
        finest = t1 - place.t <= time_resolution(t1, 2)  # cannot be cut
        accepted, width = accepted | finest, jnp.where(finest, place.width, width)
        in_one = accepted & reaches & (place.t == record.t[place.k])
        x1 = jnp.where(reaches & (place.k + 1 < last), record.x[place.k + 1], x1)
        moved = dx1 + forward.system.flow(t1, x1, mode) * dt
        if_accepted = lambda new, old: jnp.where(accepted, new, old)
        return ForwardPlace(
            k=jnp.where(accepted & reaches, place.k + 1, place.k),
            t=if_accepted(t1, place.t),
            x=if_accepted(x1, place.x),
            dx=if_accepted(dx1, place.dx),
            width=jnp.where(in_one, jnp.inf, width),
            steps=place.steps.append(t1, x1, accepted),
            steps_t=write(place.steps_t, dt, place.steps.count + 1),
            steps_x=write(place.steps_x, moved, place.steps.count + 1),
            peak=if_accepted(jnp.maximum(place.peak, lax.stop_gradient(size)), place.peak),
            tries=place.tries + 1,
        )

    return lax.while_loop(lambda place: (place.k < last) & (place.tries < control.most_tries), body, start)


def _push_step(forward: ForwardPass, mode, place: ForwardPlace, t1):
    """A step and its estimated error, and the tangents of both."""

    def vary(solver, pick):
        def step(system, x0):
            system = pick(system)
            x1, error = step_with_error(solver, system, mode, place.t, t1, x0)
            on_constraints = system.project(t1, x1, mode)
            if system.projects(mode):  # what the projection takes away is no error
                error = on_constraints - system.project(t1, x1 - error, mode)
            return on_constraints, error

        return push(step, place.tries >= 0, (forward.system, place.x), (forward.d_system, place.dx))

    return by_mode(forward.solver, forward.system, mode, vary)


def _through_event(forward: ForwardPass, motion: Motion, j, moves, taken: StepRecord, tangent: MotionTangent):
    """Saltation at event j: dx+ = S dx- + ..., with the tangents of its time and of both of its states.

    After the last segment there is no event: what is computed then is not kept."""
    dx, dt = moves
    is_event = j < motion.events.count
    place = jnp.minimum(j, motion.events.steps.shape[0] - 1)
    event = recorded_event(motion, place)
    d = push_jump_forward(forward.system, event, forward.d_system, dx, dt, is_event)
    put = lambda buffer, entry: write(buffer, jnp.where(is_event, entry, 0), place)
    last = taken.count
    t = jnp.where(is_event & is_jump(event.number), after_jump(event.states.time), taken.t[last])
    taken = taken.restart(t, jnp.where(is_event, event.states.after, taken.x[last]))
    tangent = MotionTangent(
        tangent.end, tangent.final, jax.tree.map(put, tangent.events, d.reported),
        write(tangent.steps_t, d.reported.time, last), write(tangent.steps_x, d.reported.after, last),
    )  # fmt: skip
    return jnp.where(is_event, d.state, dx), d.reported.time, taken, tangent
