"""What a candidate step shows of the guards inside it, as far as their values and rates at its ends tell."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import StepEnds
from ..numerics.cubic import first_falling_root, hides_a_dip, tangents_meet_below
from ..numerics.tolerances import closeness, rounding, time_resolution
from .guards import GuardsAtStart, are_known, first_to_fall

MUCH = 1e3
"""A guard that falls by so many times what its rates explain has jumped."""


class Before(NamedTuple):
    """What the steps before tell of the guards."""

    start: GuardsAtStart
    noise: Float[Array, "guard"]
    """Rounding granted to guards that the segment started on and has not left yet."""
    shortenings: Int[Array, ""]
    """How often the way to the next event was shortened so far."""
    stop: Float[Array, ""]
    """Where the solve ends without an event."""
    depth: Float[Array, "guard"]
    """By how much a guard may miss zero and count as grazing; below 0 for one that never does."""


class Inside(NamedTuple):
    """What a candidate step shows of the guards inside it."""

    t_root: Float[Array, ""]
    """Where to end the step: where the first guard falls through zero, or comes too near to it to tell; inf for
    neither."""
    ends_early: Bool[Array, ""]
    """Whether that is before the end of the solve."""
    split: Float[Array, ""]
    """Where to end a step that does not tell enough, as a fraction of it; inf for a step that does."""
    on_guard: Bool[Array, ""]
    """Whether it ends on a guard that falls."""
    landed_on: Int[Array, ""]
    """Which one; it means nothing where it ends on none."""
    to_go: Float[Array, ""]
    """Time after the step until a guard falls, by its rate; inf also where none is near."""
    grazes: Bool[Array, ""]
    """Whether a guard misses zero by less than can be told from an event."""
    known: Bool[Array, ""]
    """Whether its guards and their rates are numbers."""


def look_inside(step: StepEnds, before: Before) -> Inside:
    """What the guards do in a step. Most steps are let through by a glance, whatever the number of guards."""
    never = jnp.full_like(step.t0, jnp.inf)
    no, yes = jnp.array(False), jnp.array(True)
    nothing = Inside(never, no, never, no, jnp.array(-1), never, no, yes)
    return lax.cond(_is_far_from_guards(step, before), lambda: nothing, lambda: _look(step, before))


def _is_far_from_guards(step: StepEnds, before: Before) -> Bool[Array, ""]:
    """Whether every guard stays well above zero, by its tangents at both ends and by what it bends between them.

    Every rule of `_look` finds nothing in such a step. It is false for guards that are no numbers."""
    h = step.t1 - step.t0
    g0, d0, g1, d1 = step.guard0, step.rate0 * h, step.guard1, step.rate1 * h
    lowest = jnp.minimum(jnp.minimum(g0, g0 + d0), jnp.minimum(g1, g1 - d1))  # no more than any point of the cubic
    bend = jnp.abs(g1 - g0 - (d0 + d1) / 2)
    far = lowest > 2 * bend + before.start.guard_rounding + before.noise
    return jnp.all(far) & (before.shortenings == 0) & (h > time_resolution(step.t1, 8))


def _look(step: StepEnds, before: Before) -> Inside:
    t0, t1, h = step.t0, step.t1, step.t1 - step.t0
    guard, rate, rounded = step.guard1, step.rate1, before.start.guard_rounding
    on_guard = _on_guard(step, before)
    # A guard that was just left may be below zero by its rounding while it rises: no crossing.
    rising = (rate >= 0) & (guard < 0) & (guard >= -rounded)
    end = jnp.where(rising, 0, guard + before.noise)
    root, miss = first_falling_root(step.guard0, step.rate0 * h, end, rate * h, rounded)
    is_shortest = h <= time_resolution(t0, 1)  # no shorter step can be taken: its end is where the event is
    known = are_known(guard, rate)  # a guard that is no number would never fall
    t_root = t0 + jnp.min(jnp.where(on_guard | is_shortest | ~known, jnp.inf, root), initial=jnp.inf) * h
    ends = (step.guard0, step.rate0 * h, jnp.where(rising, 0, guard), rate * h, rounded + before.noise)
    split = jnp.min(tangents_meet_below(*ends), initial=jnp.inf)
    split = jnp.where(jnp.isinf(split) & hides_a_dip(*ends), 0.5, split)
    split = jnp.where(h > time_resolution(t0, 8), split, jnp.inf)
    ends_early = t_root < before.stop - time_resolution(t1, 3)
    to_go = jnp.min(jnp.where(rate < 0, guard / jnp.where(rate < 0, -rate, 1), jnp.inf), initial=jnp.inf)
    landed_on, grazes = first_to_fall(on_guard, guard, rate), jnp.any(miss <= before.depth)
    split = jnp.where(known, split, 0.5)
    return Inside(t_root, ends_early, split, jnp.any(on_guard), landed_on, to_go, grazes, known)


def _on_guard(step: StepEnds, before: Before) -> Bool[Array, "guard"]:
    """Guards that are zero at the candidate's end, to what time and rounding can resolve, and falling."""
    h, guard, rate, rounded = step.t1 - step.t0, step.guard1, step.rate1, before.start.guard_rounding
    # A guard that the segment has not left yet fires only after a root inside a step was found.
    may_fire = (before.noise == 0) | (before.shortenings > 0)
    close = jnp.abs(guard) <= rounded - time_resolution(step.t1, before.shortenings) * rate
    below_after_shortest = (h <= time_resolution(step.t0, 1)) & (guard < 0)
    # A guard that jumps below zero fires as well, whatever its rate is there: the system says what that means.
    fell = step.guard0 - guard
    explained = MUCH * h * (jnp.abs(step.rate0) + jnp.abs(rate))
    noise = closeness(guard.dtype) / rounding(guard.dtype) * rounded
    jumped = below_after_shortest & (fell > explained + noise)
    return may_fire & (((rate < 0) & (close | below_after_shortest)) | jumped)
