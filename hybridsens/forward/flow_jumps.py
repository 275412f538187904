"""Jumps of the flow that no event and no declared time tells of, found in the steps that a motion has taken.

The error control comes over such a jump by a step so short that it hardly matters to the state. It matters to every
derivative: that of the instant at which the motion meets the jump is missing. The same holds for what is smooth, and
changes within less than that step.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import AbstractFlatSystem, Mode
from ..status import Status
from .record import Motion, StepRecord, segment, segment_end

SHORT = 0.05
"""Steps longer than this part of the mean one are not looked at: they resolve what they pass."""
CHANGE = 1e-3
"""The flow must change by this part of itself."""
NOISE = 0.8
"""And the state, by what has changed, within the step by eps^`NOISE` of itself: a flow that is 0 but for rounding
changes by all of itself."""
OUTSIDE = 0.3
"""Over the same way just before the step, and just behind it, the flow must change by less than this part of the
change: where a step resolves the flow, what happens inside of it shows beside it."""


class Step(NamedTuple):
    """One step of the motion."""

    mode: Mode
    start: tuple[Array, Array]
    """Time and state."""
    end: tuple[Array, Array]


def told_of_flow_jumps(system: AbstractFlatSystem, least_state: Any, motion: Motion) -> Motion:
    """The motion, in doubt where its flow jumps inside of a step. Entries of the state below `least_state` are not
    looked at by its tolerances."""
    steps = motion.steps
    mean_step = (motion.t - steps.t[0]) / jnp.maximum(steps.count, 1)
    jumps = lambda k: jumps_inside(system, least_state, _step(motion, k))
    k = first_jump(steps, mean_step, jumps, motion.status == Status.successful)
    found = k < steps.count
    doubt = motion.doubt.also(found, Status.flow_jumps, steps.t[k])
    return dataclasses.replace(motion, doubt=doubt, status=Status.where(found, Status.flow_jumps, motion.status))


def first_jump(steps: StepRecord, mean_step, jumps: Callable, wanted) -> Int[Array, ""]:
    """The first recorded step inside of which the flow `jumps`; their number where there is none, or none is `wanted`.

    Only steps much shorter than the mean one are looked at: most motions have none but beside their events."""
    times, count = steps.t, steps.count

    def next_short(k):
        is_long = lambda k: (k < count) & (times[k + 1] - times[k] > SHORT * mean_step)
        return lax.while_loop(is_long, lambda k: k + 1, k)

    def look(carry):
        k, _ = carry
        found = jumps(k)
        return jnp.where(found, k, next_short(k + 1)), found

    goes_on = lambda carry: wanted & (carry[0] < count) & ~carry[1]
    k, found = lax.while_loop(goes_on, look, (next_short(jnp.array(0)), jnp.array(False)))
    return jnp.where(found, k, count)


def _step(motion: Motion, k: Int[Array, ""]) -> Step:
    """Step k, whose end is that before an event where it ends a segment."""
    events, steps = motion.events, motion.steps
    j = jnp.sum((events.steps <= k) & (jnp.arange(events.steps.shape[0]) < events.count))
    mode, _, end = segment(motion, j)
    ends_segment = k + 1 == end
    place = jnp.minimum(j, events.steps.shape[0] - 1)
    at_end = jnp.where(j < events.count, events.states.before[place], motion.x)
    t1 = jnp.where(ends_segment, segment_end(motion, j), steps.t[k + 1])
    return Step(mode, (steps.t[k], steps.x[k]), (t1, jnp.where(ends_segment, at_end, steps.x[k + 1])))


def jumps_inside(system: AbstractFlatSystem, least_state, step: Step) -> Bool[Array, ""]:
    """Whether the flow jumps by the state inside of a step, or by the time where some times are declared.

    A jump by the time alone takes nothing from the derivative by the state, but all from that by what makes the time.
    Where no time is declared, the trace has told of such a jump already."""
    mode, (t0, x0), (t1, x1) = step
    # One step's length before it, at both ends, and behind it. In a loop: one copy to compile.
    ahead = jnp.array([-1, 0, 1, 2], x0.dtype)
    times, states = jnp.full_like(ahead, t1), x0 + ahead[:, None] * (x1 - x0)
    by_time = system.jump_times() is not None
    if by_time:
        times = jnp.concatenate([times, t0 + ahead * (t1 - t0)])
        states = jnp.concatenate([states, jnp.broadcast_to(x1, states.shape)])
    flows = lax.map(lambda at: system.flow(at[0], at[1], mode), (times, states))
    rounding = float(jnp.finfo(x0.dtype).eps) ** NOISE * (jnp.abs(x1) + least_state)
    jumps = _jumps(flows[:4], t1 - t0, rounding)
    return jumps | _jumps(flows[4:], t1 - t0, rounding) if by_time else jumps


def _jumps(flows: Float[Array, "4 state"], h, rounding) -> Bool[Array, ""]:
    """Whether the flow jumps between the second and the third of four places, h apart."""
    before, change, behind = jnp.abs(flows[1:] - flows[:-1])
    largest = jnp.maximum(jnp.abs(flows[1]), jnp.abs(flows[2]))
    matters = (change >= CHANGE * largest) & (change * h >= rounding)
    return jnp.any(matters & (OUTSIDE * change > jnp.maximum(before, behind)))
