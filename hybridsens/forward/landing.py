"""Step size control that ends a step on the first event inside it.

An event located on dense output costs several digits of the gradient. Landing costs none: when a candidate
step crosses a guard, it is rejected and the step is proposed that ends at the root of the guard's cubic; two or three repeats
end on the guard to rounding, by true steps of the solver.
"""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .cubic import first_falling_root
from .record import StepRecord


class LandingState(eqx.Module):
    """Memory between steps of one segment."""

    inner: PyTree
    """State of the error control."""
    record: StepRecord
    guard: Float[Array, "guard"]
    """Guards at the start of the step, at least 0."""
    rate: Float[Array, "guard"]
    """Their rates there."""
    leaving: Bool[Array, "guard"]
    """Guards that the segment started on and has not left yet."""
    cuts: Int[Array, ""]
    """How often the way to the next event was shortened so far."""
    free_step: Float[Array, ""]
    """The step that the error control would take if there were no event."""
    rejected: Int[Array, ""]


class LandingController(diffrax.AbstractStepSizeController):
    """Error control by `inner`, plus landing on events; `args` is (system, mode).

    Ends the solve with `RESULTS.event_occurred` when a step ended on a guard.
    """

    inner: diffrax.AbstractAdaptiveStepSizeController
    first_step: Float[Array, ""]
    end: Float[Array, ""]
    record: StepRecord
    rejected: Int[Array, ""]

    def wrap(self, direction):
        return self  # time always runs forward here

    def init(self, terms, t0, t1, y0, dt0, args, func, error_order):
        del dt0  # Diffrax checks a dt0 by a host callback, which a compiled loop must not hold
        t1, inner = self.inner.init(terms, t0, t1, y0, self.first_step, args, func, error_order)
        system, mode = args
        guard, rate = system.guards_and_rates(t0, y0, mode)
        leaving = (guard <= 0) | ((rate > 0) & (guard <= time_resolution(t0, 4) * rate))
        state = LandingState(
            inner, self.record, jnp.maximum(guard, 0), jnp.where(leaving, jnp.maximum(rate, 0), rate), leaving,
            jnp.array(0), self.first_step, self.rejected,
        )  # fmt: skip
        return t1, state

    def adapt_step_size(self, t0, t1, y0, y1_candidate, args, y_error, error_order, controller_state):
        state: LandingState = controller_state
        system, mode = args
        accurate, next_t0, next_t1, _, inner, _ = self.inner.adapt_step_size(
            t0, t1, y0, y1_candidate, args, y_error, error_order, state.inner
        )
        guard, rate = system.guards_and_rates(t1, y1_candidate, mode)
        h = t1 - t0
        resolution = time_resolution(t1, state.cuts)
        armed = ~state.leaving | (state.rate > 0)
        on_guard = armed & (rate < 0) & (jnp.abs(guard) <= -resolution * rate)
        root = first_falling_root(state.guard, state.rate * h, guard, rate * h)
        t_root = t0 + jnp.min(jnp.where(on_guard, jnp.inf, root), initial=jnp.inf) * h
        crossed = t_root < self.end - time_resolution(t1, 3)
        cut = accurate & crossed
        keep = accurate & ~crossed
        landed = keep & jnp.any(on_guard)

        # A step that was cut and fell short of the guard is kept, and the next one aims at the guard by its rate.
        to_go = jnp.min(jnp.where(rate < 0, guard / jnp.where(rate < 0, -rate, 1), jnp.inf), initial=jnp.inf)
        short = keep & (state.cuts > 0) & (to_go < 0.1 * h)
        next_t1 = jnp.where(short, t1 + to_go, next_t1)
        next_t1 = jnp.where(cut, jnp.maximum(t_root, t0 + time_resolution(t0, 0)), next_t1)
        next_t0 = jnp.where(keep, t1, t0)

        error_control_step = jnp.where(accurate, jnp.where(cut, h, next_t1 - next_t0), state.free_step)
        free_step = jnp.where(state.cuts > 0, state.free_step, error_control_step)
        new = LandingState(
            inner=jax.tree.map(lambda new, old: jnp.where(cut, old, new), inner, state.inner),
            record=state.record.append(t1, y1_candidate, keep),
            guard=jnp.where(keep, jnp.maximum(guard, 0), state.guard),
            rate=jnp.where(keep, rate, state.rate),
            leaving=state.leaving & ~(keep & (guard > 0)),
            cuts=jnp.where(cut, state.cuts + 1, jnp.where(short | ~keep, state.cuts, 0)),
            free_step=free_step,
            rejected=state.rejected + ~keep,
        )
        result = self._result(t0, next_t1, keep, landed, new)
        return keep, next_t0, next_t1, False, new, result

    def _result(self, t0, next_t1, keep, landed, state: LandingState):
        R = diffrax.RESULTS
        capacity = state.record.t.shape[0] - 2
        full = state.record.count + state.rejected >= capacity
        stuck = ~keep & ~(next_t1 - t0 > time_resolution(t0, -1))
        result = R.where(full, R.max_steps_reached, R.successful)
        result = R.where(stuck, R.dt_min_reached, result)
        return R.where(landed, R.event_occurred, result)


def time_resolution(t, relaxation) -> Float[Array, ""]:
    """How exactly an event can be placed in time: 4 units in the last place, times 4^relaxation.

    The landing relaxes it with every cut, so that it ends also where rounding in the guard is worse than in time."""
    spacing = jnp.finfo(t.dtype).eps * jnp.abs(t) + jnp.finfo(t.dtype).tiny
    if isinstance(relaxation, int):
        return 4.0 ** (1 + relaxation) * spacing
    return 4 * spacing * jnp.left_shift(1, 2 * jnp.minimum(relaxation, 12)).astype(t.dtype)
