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
from ..numerics.small_arrays import all_of, any_of, smallest
from ..numerics.tolerances import closeness, rounding, time_resolution
from .cubic import first_falling_root, hides_a_dip, tangents_meet_below
from .guards import GuardsAtStart, are_known, first_to_fall
from .record import StepRecord

LEAST_SEARCHED = 1 / 64
"""A search that is given up ends the step where it got to, if that is at least this fraction of it; else the step is
kept and the motion counts as grazing."""

MUCH = 1e3
"""A guard that falls by so many times what its rates explain has jumped."""


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
    """How often the way to the next event was shortened so far."""
    free_step: Float[Array, ""]
    """The step that the error control would take if there were no event."""
    rejected: Int[Array, ""]
    landed_on: Int[Array, ""]
    """The guard that the last step ended on; it means nothing where the step ended on none."""
    grazing: Bool[Array, ""]
    """Whether a guard was missed by less than can be told from an event."""
    finite: Bool[Array, ""]
    """Whether the last candidate was finite."""


class Inside(NamedTuple):
    """What a candidate step shows of the guards inside it."""

    t_root: Float[Array, ""]
    """Where to end the step: where the first guard falls through zero, or comes too near to it to tell; inf for
    neither."""
    ends_early: Bool[Array, ""]
    """Whether that is before the end of the solve."""
    split: Float[Array, ""]
    """Where to end a step that does not tell enough, as a fraction of it; inf for a step that does."""
    miss: Float[Array, "guard"]
    """By how much each guard misses zero."""


class Verdict(NamedTuple):
    """What becomes of a candidate step; none of these for one that is not accurate."""

    keep: Bool[Array, ""]
    retry_at_root: Bool[Array, ""]
    """It is tried again, to end on an event."""
    must_split: Bool[Array, ""]
    """It is tried again, to end where it tells enough."""


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
        state = LocatorState(
            inner, self.record, jnp.where(start.leaving, 0, jnp.maximum(start.guard, 0)), rate, start.noise,
            jnp.array(0), first_step, self.rejected, jnp.array(-1), jnp.array(False), jnp.array(True),
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
        h = t1 - t0
        on_guard = self._on_guard(t0, t1, guard, rate, state)
        inside = self._look_inside(t0, t1, guard, rate, on_guard, state)
        if system.searches(t0, y0):
            begin, end, error = jnp.asarray(t0), jnp.asarray(t1), jnp.asarray(y_error)
            ends = StepEnds(begin, y0, state.guard, state.rate, end, y1_candidate, guard, rate, error, error_order)
            inside = self._search(system, mode, ends, accurate, inside, state.noise)
        # First a verdict.
        splits = ~inside.ends_early & jnp.isfinite(inside.split)
        verdict = Verdict(accurate & ~inside.ends_early & ~splits, accurate & inside.ends_early, accurate & splits)
        keep, retry_at_root, must_split = verdict
        landed = keep & any_of(on_guard)

        # Then the next step. One that was to end on a guard and fell short of it is kept, and the next one aims at the
        # guard by its rate.
        to_go = smallest(jnp.where(rate < 0, guard / jnp.where(rate < 0, -rate, 1), jnp.inf))
        fell_short = keep & (state.shortenings > 0) & (to_go < 0.1 * h)
        next_t1 = jnp.where(fell_short, t1 + to_go, next_t1)
        next_t1 = jnp.where(retry_at_root, jnp.maximum(inside.t_root, t0 + time_resolution(t0, 0)), next_t1)
        next_t1 = jnp.where(must_split, t0 + inside.split * h, next_t1)
        next_t0 = jnp.where(keep, t1, t0)

        # Then the new state.
        shortenings = jnp.where(fell_short | ~keep, state.shortenings, 0)
        new = LocatorState(
            # The error control forgets a step that was rejected for an event and not for its error.
            inner=jax.tree.map(lambda new, old: jnp.where(accurate & ~keep, old, new), inner, state.inner),
            record=state.record.append(t1, y1_candidate, keep),
            guard=jnp.where(keep, jnp.maximum(guard, 0), state.guard),
            rate=jnp.where(keep, rate, state.rate),
            noise=jnp.where(keep & (guard > state.noise), 0, state.noise),
            shortenings=jnp.where(retry_at_root, state.shortenings + 1, shortenings),
            free_step=self._free_step(h, t1, next_t1 - next_t0, accurate, verdict, state),
            rejected=state.rejected + ~keep,
            landed_on=first_to_fall(on_guard, guard, rate),
            grazing=state.grazing | (accurate & any_of(inside.miss <= system.grazing_depth(mode))),
            finite=all_of(jnp.isfinite(y1_candidate)) & are_known(guard, rate),
        )
        return keep, next_t0, next_t1, False, new, self._result(next_t0, next_t1, keep, landed, new)

    def _free_step(self, h, t1, next_h, accurate, verdict: Verdict, state: LocatorState):
        """The step that the error control would take if there were no event."""
        step = jnp.where(accurate, jnp.where(verdict.retry_at_root, h, next_h), state.free_step)
        # A step that ended with the horizon, or at a known time, was shorter than the error control would have it.
        clipped = verdict.keep & (t1 >= self.stop)
        step = jnp.where(clipped, jnp.maximum(step, state.free_step), step)
        return jnp.where(state.shortenings > 0, state.free_step, step)

    def _look_inside(self, t0, t1, guard, rate, on_guard, state: LocatorState) -> Inside:
        """What the guards did between the ends of a step, as far as their values and rates there tell."""
        h = t1 - t0
        # A guard that was just left may be below zero by its rounding while it rises: no crossing.
        rising = (rate >= 0) & (guard < 0) & (guard >= -self.start.guard_rounding)
        end = jnp.where(rising, 0, guard + state.noise)
        root, miss = first_falling_root(state.guard, state.rate * h, end, rate * h, self.start.guard_rounding)
        is_shortest = h <= time_resolution(t0, 1)  # no shorter step can be taken: its end is where the event is
        known = are_known(guard, rate)  # a guard that is no number would never fall
        t_root = t0 + smallest(jnp.where(on_guard | is_shortest | ~known, jnp.inf, root)) * h
        granted = self.start.guard_rounding + state.noise
        ends = (state.guard, state.rate * h, jnp.where(rising, 0, guard), rate * h, granted)
        split = smallest(tangents_meet_below(*ends))
        split = jnp.where(jnp.isinf(split) & hides_a_dip(*ends), 0.5, split)
        split = jnp.where(h > time_resolution(t0, 8), split, jnp.inf)
        ends_early = t_root < self.stop - time_resolution(t1, 3)
        return Inside(t_root, ends_early, jnp.where(known, split, 0.5), miss)

    def _search(self, system, mode, ends: StepEnds, accurate, inside: Inside, noise) -> Inside:
        """What a search of the inside of the step adds where its ends show nothing."""
        h = ends.t1 - ends.t0
        wanted = accurate & ~inside.ends_early & jnp.isinf(inside.split) & (h > time_resolution(ends.t0, 8))
        # The end was judged before: without its own depth the search would find it again.
        tolerance = self.start.guard_rounding + noise + jnp.maximum(-ends.guard1, 0)
        searched = system.search(ends, mode, tolerance, wanted)
        found = jnp.isfinite(searched.crossing)
        gave_up = ~found & (searched.reached < 1)
        far = searched.reached > LEAST_SEARCHED
        return Inside(
            jnp.where(found, ends.t0 + searched.crossing * h, inside.t_root),
            inside.ends_early | found,
            jnp.where(gave_up & far, searched.reached, inside.split),
            jnp.where(gave_up & ~far, 0, inside.miss),
        )

    def _on_guard(self, t0, t1, guard, rate, state: LocatorState):
        """Guards that are zero at the candidate's end, to what time and rounding can resolve, and falling."""
        # A guard that the segment has not left yet fires only after a root inside a step was found.
        may_fire = (state.noise == 0) | (state.shortenings > 0)
        close = jnp.abs(guard) <= self.start.guard_rounding - time_resolution(t1, state.shortenings) * rate
        below_after_shortest = (t1 - t0 <= time_resolution(t0, 1)) & (guard < 0)
        # A guard that jumps below zero fires as well, whatever its rate is there: the system says what that means.
        fell = state.guard - guard
        explained = MUCH * (t1 - t0) * (jnp.abs(state.rate) + jnp.abs(rate))
        noise = closeness(guard.dtype) / rounding(guard.dtype) * self.start.guard_rounding
        jumped = below_after_shortest & (fell > explained + noise)
        return may_fire & (((rate < 0) & (close | below_after_shortest)) | jumped)

    def _result(self, next_t0, next_t1, keep, landed, state: LocatorState):
        R = diffrax.RESULTS
        tried, kept = state.record.count + state.rejected, state.record.count - self.record.count
        full = ((tried >= self.max_steps) | (kept >= self.segment_steps)) & (next_t0 < self.stop)
        stuck = ~keep & ~(next_t1 - next_t0 > time_resolution(next_t0, -1))
        result = R.where(landed, R.event_occurred, R.successful)
        result = R.where(stuck, R.dt_min_reached, result)
        return R.where(full, R.max_steps_reached, result)
