"""Step size control that ends a step on the first event inside it.

An event located on dense output costs several digits of the gradient. Landing costs none: when a candidate
step crosses a guard, it is rejected and the step is proposed that ends at the root of the guard's cubic; two or
three repeats end on the guard to rounding, by true steps of the solver.
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
from .record import StepRecord

LEAST_SEARCHED = 1 / 64
"""A search that is given up ends the step where it got to, if that is at least this fraction of it; else the step is
kept and the motion counts as grazing."""

MUCH = 1e3
"""A guard that falls by so many times what its rates explain has jumped."""


class GuardsAtStart(eqx.Module):
    """What is known of the guards where a segment starts."""

    guard: Float[Array, "guard"]
    rate: Float[Array, "guard"]
    noise: Float[Array, "guard"]
    """Rounding to be granted to a guard that the segment starts on without a rate; 0 for every other guard."""
    rounding: Float[Array, "guard"]
    """What evaluating each guard leaves."""
    leaving: Bool[Array, "guard"]
    """Guards that the segment starts on."""
    triggered: Bool[Array, "guard"]
    """Guards that are at or below zero and falling at the very start."""


def guards_at_start(system, t, x, mode) -> GuardsAtStart:
    """Tell guards that the segment leaves (it was just reset, or starts there) from guards that fire at once."""
    guard, rate = system.guards_and_rates(t, x, mode)
    size, rate_size = (jnp.broadcast_to(scale, guard.shape) for scale in system.scales(t, x, mode))
    noise, rate_noise = closeness(x.dtype) * size, closeness(x.dtype) * rate_size
    triggered = (rate < -rate_noise) & (guard <= rounding(x.dtype) * size - time_resolution(t, 0) * rate)
    leaving = (guard <= noise) & ~triggered & (rate >= -rate_noise)
    lifting = leaving & (rate <= rate_noise)  # without a rate, only its acceleration carries it off
    return GuardsAtStart(guard, rate, jnp.where(lifting, noise, 0), rounding(x.dtype) * size, leaving, triggered)


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
    triggered: Int[Array, ""]
    """The guard that the last step landed on."""
    grazing: Bool[Array, ""]
    """Whether a guard was missed by less than can be told from an event."""
    finite: Bool[Array, ""]
    """Whether the last candidate was finite."""


class Inside(NamedTuple):
    """What a candidate step shows of the guards inside it."""

    t_root: Float[Array, ""]
    """When the first guard falls through zero; inf where none does."""
    crossed: Bool[Array, ""]
    """Whether that is before the end of the horizon."""
    split: Float[Array, ""]
    """Where to end a step that does not tell enough, as a fraction of it; inf for a step that does."""
    miss: Float[Array, "guard"]
    """By how much each guard misses zero."""


class EventLocator(diffrax.AbstractStepSizeController):
    """Error control by `inner`, plus landing on events; `args` is (system, mode).

    Ends the solve with `RESULTS.event_occurred` when a step ended on a guard.
    """

    inner: diffrax.AbstractAdaptiveStepSizeController
    first_step: Float[Array, ""]
    end: Float[Array, ""]
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
        guard, rate = system.guards_and_rates(t1, y1_candidate, mode)
        h = t1 - t0
        on_guard = self._on_guard(t0, t1, guard, rate, state)
        inside = self._look_inside(t0, t1, guard, rate, on_guard, state)
        if system.searches(t0, y0):
            begin, end, error = jnp.asarray(t0), jnp.asarray(t1), jnp.asarray(y_error)
            ends = StepEnds(begin, y0, state.guard, state.rate, end, y1_candidate, guard, rate, error, error_order)
            inside = self._search(system, mode, ends, accurate, inside, state.noise)
        shortened = accurate & inside.crossed
        unresolved = ~inside.crossed & jnp.isfinite(inside.split)
        keep = accurate & ~inside.crossed & ~unresolved
        landed = keep & any_of(on_guard)

        # A step that was cut and fell short of the guard is kept, and the next one aims at the guard by its rate.
        to_go = smallest(jnp.where(rate < 0, guard / jnp.where(rate < 0, -rate, 1), jnp.inf))
        short = keep & (state.shortenings > 0) & (to_go < 0.1 * h)
        next_t1 = jnp.where(short, t1 + to_go, next_t1)
        next_t1 = jnp.where(shortened, jnp.maximum(inside.t_root, t0 + time_resolution(t0, 0)), next_t1)
        next_t1 = jnp.where(accurate & unresolved, t0 + inside.split * h, next_t1)
        next_t0 = jnp.where(keep, t1, t0)

        error_control_step = jnp.where(accurate, jnp.where(shortened, h, next_t1 - next_t0), state.free_step)
        # A step that ended with the horizon, or at a known time, was shorter than the error control would have it.
        clipped = keep & (t1 >= self.end)
        error_control_step = jnp.where(clipped, jnp.maximum(error_control_step, state.free_step), error_control_step)
        new = LocatorState(
            inner=jax.tree.map(lambda new, old: jnp.where(accurate & ~keep, old, new), inner, state.inner),
            record=state.record.append(t1, y1_candidate, keep),
            guard=jnp.where(keep, jnp.maximum(guard, 0), state.guard),
            rate=jnp.where(keep, rate, state.rate),
            noise=jnp.where(keep & (guard > state.noise), 0, state.noise),
            shortenings=jnp.where(shortened, state.shortenings + 1, jnp.where(short | ~keep, state.shortenings, 0)),
            free_step=jnp.where(state.shortenings > 0, state.free_step, error_control_step),
            rejected=state.rejected + ~keep,
            triggered=first_to_fall(on_guard, guard, rate),
            grazing=state.grazing | (accurate & any_of(inside.miss <= system.grazing_depth(mode))),
            finite=all_of(jnp.isfinite(y1_candidate)) & _known(guard, rate),
        )
        return keep, next_t0, next_t1, False, new, self._result(next_t0, next_t1, keep, landed, new)

    def _look_inside(self, t0, t1, guard, rate, on_guard, state: LocatorState) -> Inside:
        """What the guards did between the ends of a step, as far as their values and rates there tell."""
        h = t1 - t0
        # A guard that was just left may be below zero by its rounding while it rises: no crossing.
        rising = (rate >= 0) & (guard < 0) & (guard >= -self.start.rounding)
        end = jnp.where(rising, 0, guard + state.noise)
        root, miss = first_falling_root(state.guard, state.rate * h, end, rate * h, self.start.rounding)
        unresolved = h <= time_resolution(t0, 1)  # no shorter step can be taken: its end is where the event is
        known = _known(guard, rate)  # a guard that is no number would never fall
        t_root = t0 + smallest(jnp.where(on_guard | unresolved | ~known, jnp.inf, root)) * h
        ends = (state.guard, state.rate * h, jnp.where(rising, 0, guard), rate * h, self.start.rounding + state.noise)
        split = smallest(tangents_meet_below(*ends))
        split = jnp.where(jnp.isinf(split) & hides_a_dip(*ends), 0.5, split)
        split = jnp.where(h > time_resolution(t0, 8), split, jnp.inf)
        crossed = t_root < self.end - time_resolution(t1, 3)
        return Inside(t_root, crossed, jnp.where(known, split, 0.5), miss)

    def _search(self, system, mode, ends: StepEnds, accurate, inside: Inside, noise) -> Inside:
        """What a search between the ends adds where they show nothing."""
        h = ends.t1 - ends.t0
        wanted = accurate & ~inside.crossed & jnp.isinf(inside.split) & (h > time_resolution(ends.t0, 8))
        tolerance = self.start.rounding + noise + jnp.maximum(-ends.guard1, 0)  # the end was looked at before
        searched = system.search(ends, mode, tolerance, wanted)
        found = jnp.isfinite(searched.crossing)
        gave_up = ~found & (searched.reached < 1)
        far = searched.reached > LEAST_SEARCHED
        return Inside(
            jnp.where(found, ends.t0 + searched.crossing * h, inside.t_root),
            inside.crossed | found,
            jnp.where(gave_up & far, searched.reached, inside.split),
            jnp.where(gave_up & ~far, 0, inside.miss),
        )

    def _on_guard(self, t0, t1, guard, rate, state: LocatorState):
        """Guards that are zero at the candidate's end, to what time and rounding can resolve, and falling."""
        sure = (state.noise == 0) | (state.shortenings > 0)
        close = jnp.abs(guard) <= self.start.rounding - time_resolution(t1, state.shortenings) * rate
        unresolved = (t1 - t0 <= time_resolution(t0, 1)) & (guard < 0)
        # A guard that jumps below zero fires as well, whatever its rate is there: the system says what that means.
        fell = state.guard - guard
        explained = MUCH * (t1 - t0) * (jnp.abs(state.rate) + jnp.abs(rate))
        noise = closeness(guard.dtype) / rounding(guard.dtype) * self.start.rounding
        jumped = unresolved & (fell > explained + noise)
        return sure & (((rate < 0) & (close | unresolved)) | jumped)

    def _result(self, t0, next_t1, keep, landed, state: LocatorState):
        R = diffrax.RESULTS
        tried, kept = state.record.count + state.rejected, state.record.count - self.record.count
        full = ((tried >= self.max_steps) | (kept >= self.segment_steps)) & (t0 < self.end)
        stuck = ~keep & ~(next_t1 - t0 > time_resolution(t0, -1))
        result = R.where(landed, R.event_occurred, R.successful)
        result = R.where(stuck, R.dt_min_reached, result)
        return R.where(full, R.max_steps_reached, result)


def first_to_fall(candidates: Bool[Array, "guard"], guard, rate) -> Int[Array, ""]:
    """Which of the candidate guards passed zero first, by their rates; -1 where there are no guards."""
    if guard.shape[0] == 0:
        return jnp.array(-1)
    return jnp.argmax(jnp.where(candidates, guard / jnp.where(rate < 0, rate, 1), -jnp.inf))


def _known(guard, rate) -> Bool[Array, ""]:
    """Whether guards are finite and their rates are numbers; a rate may be infinite where a gap is a square root."""
    return all_of(jnp.isfinite(guard) & ~jnp.isnan(rate))
