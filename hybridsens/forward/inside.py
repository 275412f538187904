"""What a candidate step shows of the guards inside it, as far as their values and rates at its ends tell."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import StepEnds
from ..numerics.cubic import first_falling_root, hides_a_dip, inside_of_cubic, tangents_meet_below
from ..numerics.tolerances import AT_END, MOST_RELAXED, closeness, rounding, time_resolution
from .guards import first_to_fall

MUCH = 1e3
"""A guard that falls by more than `MUCH` times what its rates at the ends explain has jumped."""

BLOCK = 32
"""Many guards are examined in blocks of this size, and only blocks with one near zero."""


class Resolution(NamedTuple):
    """How well guards and times can be told apart, and where the solve ends."""

    rounding: Float[Array, "guard"]
    """Rounding error of evaluating each guard."""
    noise: Float[Array, "guard"]
    """Rounding granted to guards that the segment started on and has not left yet."""
    turns: Bool[Array, "guard"]
    """Guards that turn on zero at the end of the step, without falling through it."""
    shortenings: Int[Array, ""]
    """How many times in a row the step was shortened to end on an event: each relaxes how exactly."""
    on_a_stair: Bool[Array, "guard"]
    """Guards that may be no more than a stair of rounding from zero; see `on_a_stair`."""
    stop: Float[Array, ""]
    """Where the solve ends without an event."""
    depth: Float[Array, "guard"]
    """By how much a guard may miss zero and count as grazing; below 0 for one that never does."""


class Inside(NamedTuple):
    """What a candidate step shows of the guards inside it."""

    t_root: Float[Array, ""]
    """Where to end the step: where the first guard falls through zero, or comes too near to it to tell; inf for
    neither."""
    root_before_stop: Bool[Array, ""]
    """Whether `t_root` comes before the end of the solve: the step is then tried again, to end there."""
    split: Float[Array, ""]
    """Where to end a step that does not tell enough, as a fraction of it; inf for a step that does."""
    on_guard: Bool[Array, ""]
    """Whether it ends on a guard that falls."""
    landed_on: Int[Array, ""]
    """Which one; it means nothing where it ends on none."""
    since_zero: Float[Array, ""]
    """Time from the zero of the guard `landed_on` to the end of the step; -inf where it ends on none."""
    to_go: Float[Array, ""]
    """Time after the step until a guard falls, by its rate; inf also where none is near."""
    grazes: Bool[Array, ""]
    """Whether a guard misses zero by less than can be told from an event."""
    finite: Bool[Array, ""]
    """Whether its guards and their rates are numbers."""
    jumps: Bool[Array, ""]
    """Whether a guard that it ends on has jumped below zero, without falling."""


def is_divisible(t0, h) -> Bool[Array, ""]:
    """Whether a step may be split or searched: rounding in time is more than a part in a thousand of a shorter one."""
    return h > time_resolution(t0, 4)


def look_inside(step: StepEnds, resolution: Resolution) -> Inside:
    """What the guards do in a step. Most steps are let through by a glance, whatever the number of guards."""
    near = _near(step, resolution)
    are_many = step.guard0.shape[0] > 2 * BLOCK
    look = lambda: _look_by_blocks(step, resolution, near) if are_many else _look(step, resolution)
    return lax.cond(jnp.any(near), look, lambda: _nothing(step))


def _nothing(step: StepEnds) -> Inside:
    never, no, yes = jnp.full_like(step.t0, jnp.inf), jnp.array(False), jnp.array(True)
    return Inside(never, no, never, no, jnp.array(-1), -never, never, no, yes, no)


def _near(step: StepEnds, resolution: Resolution) -> Bool[Array, "guard"]:
    """Which guards have to be looked at: in all others `_look` finds nothing, by any of its rules.

    A guard is far if it stays well above zero, by its tangents at both ends and by what it bends between them, in a
    step that is longer than what time and rounding can resolve. A guard that is nan is near."""
    h = step.t1 - step.t0
    is_long = (h > time_resolution(step.t1, 8)) & (h > 8 * time_resolution(step.t1, resolution.shortenings))
    g0, d0, g1, d1 = step.guard0, step.rate0 * h, step.guard1, step.rate1 * h
    lowest = jnp.minimum(jnp.minimum(g0, g0 + d0), jnp.minimum(g1, g1 - d1))  # no more than any point of the cubic
    # Nor does it fall soon after: `to_go` is asked about up to a tenth of the step.
    lowest = jnp.minimum(lowest, g1 + d1 / 8)
    bend = jnp.abs(g1 - g0 - (d0 + d1) / 2)
    far = (lowest > 2 * bend + resolution.rounding + resolution.noise) & is_long
    return ~far | resolution.on_a_stair


def _look_by_blocks(step: StepEnds, resolution: Resolution, near: Bool[Array, "guard"]) -> Inside:
    """The same, block by block: those that are far from zero are passed over."""
    count = step.guard0.shape[0]

    def look_at(block, inside):
        first = jnp.minimum(block * BLOCK, count - BLOCK)  # the last block overlaps the one before

        def look():
            found = _look(*_cut(step, resolution, first))
            return _both(inside, found._replace(landed_on=first + found.landed_on))

        return lax.cond(jnp.any(lax.dynamic_slice(near, (first,), (BLOCK,))), look, lambda: inside)

    return lax.fori_loop(0, -(-count // BLOCK), look_at, _nothing(step))


def _cut(step: StepEnds, resolution: Resolution, first) -> tuple[StepEnds, Resolution]:
    """The step with the guards of one block."""
    cut = lambda of_all: lax.dynamic_slice(of_all, (first,), (BLOCK,))
    guards = {name: cut(getattr(step, name)) for name in ("guard0", "rate0", "guard1", "rate1")}
    about = {name: cut(getattr(resolution, name)) for name in ("rounding", "noise", "turns", "on_a_stair", "depth")}
    return step._replace(**guards), resolution._replace(**about)


def _both(a: Inside, b: Inside) -> Inside:
    """What a step shows of these guards and of those."""
    finite = a.finite & b.finite  # a step with a guard that is no number is split, wherever another one falls
    return Inside(
        t_root=jnp.where(finite, jnp.minimum(a.t_root, b.t_root), jnp.inf),
        root_before_stop=(a.root_before_stop | b.root_before_stop) & finite,
        split=jnp.minimum(a.split, b.split),
        on_guard=a.on_guard | b.on_guard,
        landed_on=jnp.where(b.since_zero > a.since_zero, b.landed_on, a.landed_on),
        since_zero=jnp.maximum(a.since_zero, b.since_zero),
        to_go=jnp.minimum(a.to_go, b.to_go),
        grazes=a.grazes | b.grazes,
        finite=finite,
        jumps=a.jumps | b.jumps,
    )


def _look(step: StepEnds, resolution: Resolution) -> Inside:
    """The rules, guard by guard: does it end on zero, fall through zero before, or may it dip below zero unseen?"""
    t0, t1, h = step.t0, step.t1, step.t1 - step.t0
    resolution = _without_left(step, _with_stairs(step, resolution))
    guard, rate, rounded = step.guard1, step.rate1, resolution.rounding
    on_guard, jumped = _on_guard(step, resolution)
    # A guard that was just left may be below zero by its rounding while it rises: no crossing.
    rising = (rate >= 0) & (guard < 0) & (guard >= -rounded)
    end = jnp.where(rising, 0, guard + resolution.noise)
    root, miss = first_falling_root(step.guard0, step.rate0 * h, end, rate * h, rounded)
    is_shortest = h <= time_resolution(t0, 1)  # no shorter step can be taken: its end is where the event is
    # A guard that is no number would never fall. A rate may be infinite where a gap is a square root.
    finite = jnp.all(jnp.isfinite(guard) & jnp.isfinite(step.guard0) & ~jnp.isnan(rate))
    roots = t0 + jnp.where(on_guard | is_shortest | ~finite, jnp.inf, root) * h
    early = roots < resolution.stop - time_resolution(t1, AT_END)
    # What falls so little before the end of the solve fires at the end, and by the same root: left below zero, it would
    # be lost to a solve that goes on from here.
    on_guard |= (t1 >= resolution.stop) & (guard < 0) & (rate < 0) & ~early & finite & _may_fire(resolution)
    cubic = (step.guard0, step.rate0 * h, jnp.where(rising, 0, guard), rate * h, rounded + resolution.noise)
    falls = (rate < 0) & ~resolution.turns
    above = jnp.maximum(guard + resolution.noise, 0)
    times_to_go = jnp.where(falls, above / jnp.where(falls, -rate, 1), jnp.inf)
    # Two reductions in place of eight: XLA works out anew, for each, all that it is made from.
    t_root, split, to_go = jnp.min(jnp.stack([roots, tangents_meet_below(*cubic), times_to_go]), 1, initial=jnp.inf)
    told = jnp.stack([early, hides_a_dip(*cubic), miss <= resolution.depth, on_guard & jumped, on_guard])
    root_before_stop, hides, grazes, jumps, ends_there = jnp.any(told, 1)
    split = jnp.where(jnp.isinf(split) & hides, 0.5, split)
    split = jnp.where(is_divisible(t0, h), split, jnp.inf)
    split = jnp.where(finite, split, 0.5)
    landed_on, since_zero = first_to_fall(on_guard, guard, jnp.where(jumped, -jnp.inf, rate))
    return Inside(t_root, root_before_stop, split, ends_there, landed_on, since_zero, to_go, grazes, finite, jumps)


def _on_guard(step: StepEnds, resolution: Resolution) -> tuple[Bool[Array, "guard"], Bool[Array, "guard"]]:
    """Guards that are zero at the candidate's end, to what time and rounding can resolve, and falling; and which of
    all have jumped below zero."""
    h, guard, rate, rounded = step.t1 - step.t0, step.guard1, step.rate1, resolution.rounding
    # One that the segment has not left yet is looked for where it falls through -noise.
    size = jnp.abs(guard + resolution.noise)
    close = size <= rounded - time_resolution(step.t1, resolution.shortenings) * rate
    below_after_shortest = (h <= time_resolution(step.t0, 1)) & (guard < 0)
    # A guard that jumps below zero fires as well, whatever its rate is there: the system says what that means.
    fell = step.guard0 - guard
    explained = MUCH * h * (jnp.abs(step.rate0) + jnp.abs(rate))
    counts_as_zero = closeness(guard.dtype) / rounding(guard.dtype) * rounded
    jumped = below_after_shortest & (fell > explained + counts_as_zero)
    return _may_fire(resolution) & (((rate < 0) & (close | below_after_shortest)) | jumped), jumped


def on_a_stair(step: StepEnds, blur: Float[Array, "guard"]) -> Bool[Array, "guard"]:
    """Guards that fall to zero within a time that rounding may `blur`, in a step as short as that.

    Rounding makes a guard a staircase, and how high the stairs of a multiplier are is not known."""
    rate = step.rate1
    return (rate < 0) & (step.t1 - step.t0 <= blur) & (_stair(step) <= blur * jnp.abs(rate))


def _stair(step: StepEnds) -> Float[Array, "guard"]:
    return jnp.maximum(step.guard0, jnp.abs(step.guard1))


def _with_stairs(step: StepEnds, resolution: Resolution) -> Resolution:
    """With the rounding of guards that such steps, tried again and again, do not get down to zero: a stair, and what
    the rate makes of the step."""
    tired = resolution.on_a_stair & (resolution.shortenings > MOST_RELAXED)
    seen = 2 * (_stair(step) + jnp.abs(step.rate1) * (step.t1 - step.t0))
    return resolution._replace(rounding=jnp.where(tired, seen, resolution.rounding))


def _without_left(step: StepEnds, resolution: Resolution) -> Resolution:
    """With no noise for guards that rise above it inside the step: what falls then falls through zero itself."""
    h, noise = step.t1 - step.t0, resolution.noise
    highest = jnp.max(jnp.stack(inside_of_cubic(step.guard0, step.rate0 * h, step.guard1, step.rate1 * h)), axis=0)
    return resolution._replace(noise=jnp.where(highest > 2 * noise, 0, noise))


def _may_fire(resolution: Resolution) -> Bool[Array, "guard"]:
    """A guard that the segment has not left yet fires only after a root inside a step was found."""
    return ((resolution.noise == 0) | (resolution.shortenings > 0)) & ~resolution.turns
