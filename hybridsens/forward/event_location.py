"""Step size control that ends a step on the first event inside it.

An event located on dense output costs several digits of the gradient. Landing costs none: when a candidate
step crosses a guard, it is rejected and the step is proposed that ends at the root of the guard's cubic; two or
three repeats end on the guard to rounding, by true steps of the solver.

`time_resolution(t, k)` is 4^(k+1) units in the last place of t.
"""

from typing import NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..flat_system import StepEnds
from ..numerics.tolerances import MOST_RELAXED, rounding, time_resolution
from .guards import GuardsAtStart, scales_at, turning_at_zero
from .inside import Inside, Resolution, is_divisible, look_inside, on_a_stair
from .record import StepRecord

BLUR = 1 / 3
"""What rounding, eps, may blur of the step that the error control would take, and of the time in which a guard's rate
turns: eps^BLUR, 6e-6 in float64. A step as short as that is no sign that an event was passed by: the next one goes on
as if it were the same."""

LEAST_SEARCHED = 1 / 64
"""Where a search is given up, the step is cut where the search got to, if that is at least this fraction of the step.
Else the step is kept, and the motion counts as grazing; if no guard can graze, the step is cut at this fraction."""

CRAWL = 1024
"""A motion that takes so many of the shortest steps in a row gets nowhere. Some are no sign of that: a guard
that an event left below zero by rounding needs as many as it takes to rise by it."""


class LocatorState(eqx.Module):
    """Memory between the steps of one segment."""

    inner: PyTree
    """State of the error control."""
    record: StepRecord
    guard: Float[Array, "guard"]
    """Guards at the start of the step, at least 0."""
    rate: Float[Array, "guard"]
    """Their rates there."""
    noise: Float[Array, "guard"]
    """Rounding granted to guards that the segment started on and has not left yet."""
    shortenings: Int[Array, ""]
    """How many times in a row the step was shortened to end on an event; 0 again after a step that is kept, unless that
    fell short of it or was one of the shortest."""
    free_step: Float[Array, ""]
    """The step that the error control would take if there were no event."""
    rejected: Int[Array, ""]
    landed_on: Int[Array, ""]
    """The guard that the last step ended on; it means nothing where the step ended on none."""
    grazed: Float[Array, ""]
    """End of the last step in which a guard was missed by less than can be told from an event; -inf for none."""
    guard_jumped: Bool[Array, ""]
    """Whether the guard that the last step ended on has jumped below zero, without falling."""
    finite: Bool[Array, ""]
    """Whether the last candidate was finite."""
    crawled: Int[Array, ""]
    """How many steps in a row were of the shortest length that time resolves."""


class Verdict(NamedTuple):
    """What becomes of a candidate step. All three are False for one that failed the error control."""

    keep: Bool[Array, ""]
    retry_at_root: Bool[Array, ""]
    """It is tried again, to end on an event."""
    must_split: Bool[Array, ""]
    """It is tried again, shorter, since its ends do not tell enough of what the guards do in it."""

    @classmethod
    def of(cls, accurate, inside: Inside) -> "Verdict":
        """By the error control and by what the step shows."""
        splits = ~inside.root_before_stop & jnp.isfinite(inside.split)
        return cls(accurate & ~inside.root_before_stop & ~splits, accurate & inside.root_before_stop, accurate & splits)


class EventLocator(diffrax.AbstractStepSizeController):
    """Error control by `inner`, plus landing on events; `args` is (system, mode).

    Ends the solve with `RESULTS.event_occurred` when a step ended on a guard.
    """

    inner: diffrax.AbstractAdaptiveStepSizeController
    first_step: Float[Array, ""]
    stop: Float[Array, ""]
    """Where the solve ends without an event: the next known time, or the end of the horizon."""
    record: StepRecord
    rejected: Int[Array, ""]
    start: GuardsAtStart
    max_steps: int = eqx.field(static=True)
    segment_steps: int = eqx.field(static=True)

    def wrap(self, direction):
        return self  # time always runs forward here

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order):
        del dt0  # Diffrax checks a dt0 by a host callback, which a compiled loop must not hold
        first_step = self._first_step(terms, t0, t1, y0, args, func, error_order)
        t1, inner = self.inner.init(terms, t0, t1, y0, first_step, args, func, error_order)
        start = self.start
        rate = jnp.where(start.leaving, jnp.maximum(start.rate, 0), start.rate)
        never, no, yes = jnp.full_like(rate, -jnp.inf, shape=()), jnp.array(False), jnp.array(True)
        state = LocatorState(
            inner, self.record, jnp.where(start.leaving, 0, jnp.maximum(start.guard, 0)), rate, start.noise,
            jnp.array(0), first_step, self.rejected, jnp.array(-1), never, no, yes, jnp.array(0),
        )  # fmt: skip
        return t1, state

    def _first_step(self, terms, t0, t1, y0, args, func, error_order):
        """The step that is known from the segment before, or one that the error control finds."""
        find = lambda: self.inner.init(terms, t0, t1, y0, None, args, func, error_order)[0] - t0
        return lax.cond(self.first_step > 0, lambda: self.first_step, find)

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        state: LocatorState = controller_state
        system, mode = args
        accurate, next_t0, next_t1, _, inner, _ = self.inner.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, state.inner
        )
        accurate = jnp.asarray(accurate)
        guard, rate = system.guards_and_rates(t1, y1_candidate, mode)
        begin, end, error = jnp.asarray(t0), jnp.asarray(t1), jnp.asarray(y_error)
        step = StepEnds(begin, y0, state.guard, state.rate, end, y1_candidate, guard, rate, error, error_order)
        h = t1 - t0
        resolution = self._resolution(system, mode, step, state)
        noise, turns = resolution.noise, resolution.turns
        inside = _look(system, mode, step, accurate, resolution)
        # First a verdict.
        verdict = Verdict.of(accurate, inside)
        keep, retry_at_root, must_split = verdict
        landed = keep & inside.on_guard

        # Then the next step. One that was to end on a guard and fell short of it is kept, and the next one aims at the
        # guard by its rate.
        fell_short = keep & (state.shortenings > 0) & (inside.to_go < 0.1 * h)
        next_t1 = jnp.where(fell_short, t1 + inside.to_go, next_t1)
        next_t1 = jnp.where(retry_at_root, jnp.maximum(inside.t_root, t0 + time_resolution(t0, 0)), next_t1)
        next_t1 = jnp.where(must_split, t0 + inside.split * h, next_t1)
        next_t0 = jnp.where(keep, t1, t0)

        # Then the new state.
        new = LocatorState(
            # The error control forgets a step that was rejected for an event and not for its error.
            inner=jax.tree.map(lambda new, old: jnp.where(accurate & ~keep, old, new), inner, state.inner),
            record=state.record.append(t1, y1_candidate, keep),
            # One that turns on zero is left as one that the segment starts on.
            guard=jnp.where(keep, jnp.where(turns, 0, jnp.maximum(guard, 0)), state.guard),
            rate=jnp.where(keep, jnp.where(turns, jnp.maximum(rate, 0), rate), state.rate),
            noise=jnp.where(keep, jnp.where(guard > noise, 0, noise), state.noise),
            shortenings=self._shortenings(verdict, fell_short, jnp.any(resolution.on_a_stair), state),
            free_step=self._free_step(h, t1, next_t1 - next_t0, accurate, verdict, state),
            rejected=state.rejected + ~keep,
            landed_on=inside.landed_on,
            grazed=jnp.where(accurate & inside.grazes, t1, state.grazed),
            guard_jumped=inside.jumps,
            finite=jnp.all(jnp.isfinite(y1_candidate)) & inside.finite,
            crawled=jnp.where(keep, jnp.where(h <= time_resolution(t0, 1), state.crawled + 1, 0), state.crawled),
        )
        # A step of a few units of the last place is as long once more, by rounding, and would fail for ever; so would
        # one to an event that it does not end on, however little is asked for.
        again = ~keep & ~(next_t1 < t1) & (~accurate | (state.shortenings > MOST_RELAXED))
        return keep, next_t0, next_t1, False, new, self._result(next_t0, next_t1, again, keep, landed, new)

    def _resolution(self, system, mode, step: StepEnds, state: LocatorState) -> Resolution:
        """What can be told of the guards in a candidate step."""
        turns, turn_noise = turning_at_zero(system, step, mode)
        noise = jnp.where(turns, jnp.maximum(state.noise, turn_noise), state.noise)
        depth = jnp.broadcast_to(system.grazing_depth(mode), step.guard1.shape)
        size = scales_at(system, step.t1, step.x1, mode, step.guard1)[0] + system.clock_scales(step.t1, mode)
        rounded = rounding(step.guard1.dtype) * size
        # A flow that is known exactly is stepped through without limit, and how long a rate lasts tells more.
        lasts = jnp.abs(step.rate1) * (step.t1 - step.t0) / jnp.abs(step.rate1 - step.rate0)
        blur = float(jnp.finfo(lasts.dtype).eps) ** BLUR * jnp.fmin(lasts, state.free_step)
        return Resolution(rounded, noise, turns, state.shortenings, on_a_stair(step, blur), self.stop, depth)

    def _shortenings(self, verdict: Verdict, fell_short, on_a_stair, state: LocatorState):
        """One more after a step that is tried again to end on an event; as many after one that did not get there."""
        keep, retry_at_root, must_split = verdict
        so_far = jnp.where(fell_short | (keep & on_a_stair) | ~keep, state.shortenings, 0)
        more = retry_at_root | (must_split & on_a_stair & (state.shortenings > 0))
        return jnp.where(more, state.shortenings + 1, so_far)

    def _free_step(self, h, t1, next_h, accurate, verdict: Verdict, state: LocatorState):
        """The step that the error control would take if there were no event."""
        step = jnp.where(accurate, jnp.where(verdict.retry_at_root, h, next_h), state.free_step)
        # A step that ended with the horizon, or at a known time, was shorter than the error control would have it.
        clipped = verdict.keep & (t1 >= self.stop)
        step = jnp.where(clipped, jnp.maximum(step, state.free_step), step)
        return jnp.where(state.shortenings > 0, state.free_step, step)

    def _result(self, next_t0, next_t1, again, keep, landed, state: LocatorState):
        R = diffrax.RESULTS
        tried, kept = state.record.count + state.rejected, state.record.count - self.record.count
        full = ((tried >= self.max_steps) | (kept >= self.segment_steps)) & (next_t0 < self.stop)
        stuck = again | (~keep & ~(next_t1 - next_t0 > time_resolution(next_t0, -1))) | (state.crawled >= CRAWL)
        result = R.where(landed, R.event_occurred, R.successful)
        result = R.where(stuck, R.dt_min_reached, result)
        return R.where(full, R.max_steps_reached, result)


def _look(system, mode, step: StepEnds, accurate, resolution: Resolution) -> Inside:
    """What a candidate step shows: by its ends, and by a search of its inside where the system has one."""
    inside = look_inside(step, resolution)
    if system.searches(step.t0, step.x0):
        inside = _search(system, mode, step, accurate, inside, resolution)
    return inside


def _search(system, mode, ends: StepEnds, accurate, inside: Inside, resolution: Resolution) -> Inside:
    """What a search of the inside of the step adds where its ends show nothing."""
    h = ends.t1 - ends.t0
    wanted = accurate & ~inside.root_before_stop & jnp.isinf(inside.split) & is_divisible(ends.t0, h)
    # `look_inside` has judged the end: the search is not to find again what lies below zero there.
    tolerance = resolution.rounding + resolution.noise + jnp.maximum(-ends.guard1, 0)
    searched = system.search(ends, mode, tolerance, wanted)
    found = jnp.isfinite(searched.crossing)
    gave_up = ~found & (searched.reached < 1)
    can_graze = jnp.any(resolution.depth >= 0)
    got_far = ~can_graze | (searched.reached > LEAST_SEARCHED)
    return inside._replace(
        t_root=jnp.where(found, ends.t0 + searched.crossing * h, inside.t_root),
        root_before_stop=inside.root_before_stop | found,
        split=jnp.where(gave_up & got_far, jnp.maximum(searched.reached, LEAST_SEARCHED), inside.split),
        grazes=inside.grazes | (gave_up & ~got_far) | (searched.grazes & can_graze),
    )
