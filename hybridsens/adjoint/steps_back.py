"""The backward pass over the steps of one segment: each as it was, or cut where psi or dJ/dtheta need shorter ones."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import AbstractFlatSystem
from ..forward.record import Motion
from ..forward.solver import one_step
from ..numerics.tolerances import time_resolution
from ..observables import Observables
from ..xla.once import computed_once
from ..xla.packed import pack
from .control import DerivativeControl, is_noise
from .methods import AbstractGradientMethod
from .no_length import pull_in_no_time
from .segment_steps import SegmentSteps
from .step import RecordedStep, StepBack


class BackwardPass(NamedTuple):
    """What the backward pass is made from; constant while it runs."""

    system: AbstractFlatSystem
    step_parameter_mask: Any
    """Which of its leaves are parameters that a step depends on."""
    adjoint: AbstractGradientMethod
    solver: diffrax.AbstractSolver
    """That of the motion, for steps that are differentiated."""
    controlled: bool
    """Whether steps are cut where they do not resolve the derivative."""
    control: DerivativeControl
    cotangent: Observables
    """Derivatives of the cost by everything that is reported of the motion; its events are rows of the record."""
    ts: Float[Array, "sample"] | None
    find_steps: Callable[[Motion, Int[Array, ""]], SegmentSteps]
    """Gives the steps of a segment."""

    @property
    def step_parameters(self) -> Any:
        """theta, as far as a step depends on it."""
        return eqx.filter(self.system, self.step_parameter_mask)


class BackwardState(NamedTuple):
    """Where a sweep stands: the costate, the sums for dJ/dtheta, and what the error control remembers."""

    psi: Float[Array, "state"]
    """The costate itself."""
    by_dt: Float[Array, ""]
    """Derivative by the time of an event that came at once, for the event that caused it."""
    total: Any
    """What the steps have added to dJ/dtheta, packed."""
    gathered: Any
    """Sum of the absolute values of all that steps and events have added: errors are measured by it."""
    worst: Any
    """Largest error of any step in `total`."""
    peak: Float[Array, ""]
    """The largest size that psi had."""
    least_scale: Any
    """Errors are measured by no less than this: `FORESEEN` times what the first sweep gathered; 0 in the first."""
    judges_gradient: Array
    """Whether a step is also judged by what it adds to dJ/dtheta: in the second sweep."""
    samples_left: Int[Array, ""]
    """How many data times are not passed yet; the next one is ts[samples_left - 1]."""
    tries: Int[Array, ""]
    """Steps tried."""


class BackwardPlace(NamedTuple):
    """Where the backward pass stands inside of a segment."""

    k: Int[Array, ""]
    """The recorded step."""
    right: Float[Array, ""]
    """How far psi has come."""
    width: Float[Array, ""]
    """Longest step to try; inf for as long as the recorded one."""


def through_steps(backward: BackwardPass, steps: SegmentSteps, end, at: BackwardState) -> BackwardState:
    """Adjoint of the steps of one segment, from its end: each recorded step at once, or in as many as are needed.

    A turn of the loop tries one step."""

    def body(carry):
        place, at = carry
        tried = _try_step(backward, steps, place, at)
        moved = _carried_on(backward, steps.mode, at, tried)
        at = jax.tree.map(lambda new, old: jnp.where(tried.accepted, new, old), moved, at)
        return _next_place(steps, end, place, tried), at._replace(tries=at.tries + 1)

    def goes_on(carry):
        place, at = carry
        return (place.k >= steps.first) & (at.tries < backward.control.most_tries)

    never = jnp.full_like(end, jnp.inf)
    place = BackwardPlace(steps.last - 1, end, never)
    return lax.while_loop(goes_on, body, (place, at))[1]


class TriedStep(NamedTuple):
    """A step back, and what is made of it."""

    left: Float[Array, ""]
    """Where it ends."""
    x: Float[Array, "state"]
    """The state there."""
    is_data: Bool[Array, ""]
    """Whether that is a data time."""
    reaches_start: Bool[Array, ""]
    """Whether that is the start of the recorded step."""
    step: StepBack
    accepted: Bool[Array, ""]
    width: Float[Array, ""]
    """Longest step to try next."""
    size: Float[Array, ""]
    """Of psi."""
    gathered: Any
    """As in `BackwardState`, with what this step adds."""
    peak: Float[Array, ""]
    """The same, with this size."""


def _try_step(backward: BackwardPass, steps: SegmentSteps, place: BackwardPlace, at: BackwardState) -> TriedStep:
    start = steps.record.t[place.k]
    left, is_data = _left_end(backward, start, place, at.samples_left)
    reaches_start, h = (left == start) & ~is_data, place.right - left
    x0 = _state_at(backward, steps.mode, reaches_start, start, left, steps.record.x[place.k])
    go = lambda: _carry_back(backward, steps.mode, left, place.right, x0, at.psi)
    step = computed_once(at.tries >= 0, go)  # always true, which XLA cannot foresee
    gathered = jax.tree.map(lambda known, new: known + jnp.abs(new), at.gathered, step.total)
    judge = lambda: _judge(backward, x0, at._replace(gathered=gathered), step, h, place.width)
    accepted, width, size, peak = computed_once(at.tries >= 0, judge)
    finest = h <= time_resolution(place.right, 2)  # cannot be cut: two data times may coincide
    width = jnp.where(finest, place.width, width)
    return TriedStep(left, x0, is_data, reaches_start, step, accepted | finest, width, size, gathered, peak)


def _carried_on(backward: BackwardPass, mode, at: BackwardState, tried: TriedStep) -> BackwardState:
    """Where the sweep stands after a step that is accepted."""
    step = tried.step
    total = jax.tree.map(jnp.add, at.total, step.total)
    total, psi, samples_left = _add_data(backward, mode, tried, (total, step.psi), at.samples_left)
    worst = at.worst
    if step.total_error is not None:
        counts = ~is_noise(tried.size, tried.peak)
        larger = lambda known, new: jnp.maximum(known, (counts * jnp.abs(new)).astype(new.dtype))
        worst = jax.tree.map(larger, worst, step.total_error)
    return at._replace(
        psi=psi, total=total, gathered=tried.gathered, worst=worst, peak=tried.peak, samples_left=samples_left
    )


def _next_place(steps: SegmentSteps, end, place: BackwardPlace, tried: TriedStep) -> BackwardPlace:
    """Where a recorded step was taken in one piece, the next is tried in one piece too."""
    step_end = jnp.where(place.k + 1 < steps.last, steps.record.t[place.k + 1], end)
    step_done = tried.accepted & tried.reaches_start
    width = jnp.where(step_done & (place.right == step_end), jnp.inf, tried.width)
    k = jnp.where(step_done, place.k - 1, place.k)
    return BackwardPlace(k, jnp.where(tried.accepted, tried.left, place.right), width)


def _state_at(backward: BackwardPass, mode, is_start, start, t, x):
    """The state at t inside of a recorded step, by a step from its start, where the state is x. The recorded step met
    the tolerance, and so does a shorter one from the same start."""
    return lax.cond(is_start, lambda: x, lambda: one_step(backward.solver, backward.system, mode, start, t, x))


def _carry_back(backward: BackwardPass, mode, t0, t1, x0, psi) -> StepBack:
    """One step back. What it adds to dJ/dtheta is packed, because the error control then works on few arrays."""
    parameters, static = eqx.partition(backward.system, backward.step_parameter_mask)
    step = RecordedStep(parameters, static, mode, t0, t1, x0, backward.solver, backward.controlled)
    done = backward.adjoint.carry_back(step, psi)
    error = None if done.total_error is None else pack(done.total_error)
    return done._replace(total=pack(done.total), total_error=error)


def _left_end(backward: BackwardPass, start, place: BackwardPlace, samples_left) -> tuple[Array, Bool[Array, ""]]:
    """Where the step back ends, and whether that is a data time: there, at the recorded step's start, or as far as it
    may go. Parts are shorter than `width`, because the error estimate exaggerates the error of short steps.

    A data time at which a step starts or ends takes a step of no length, and one that is given twice takes two: in a
    second derivative they move apart. It is taken along with the steps, which then keep their lengths."""
    cut = backward.control.cut(place.width)
    left = jnp.where(place.right - start <= place.width, start, place.right - cut)
    if backward.ts is None:
        return left, jnp.array(False)
    data_time = jnp.where(samples_left > 0, backward.ts[jnp.maximum(samples_left - 1, 0)], -jnp.inf)
    is_data = data_time >= left
    data_time = data_time - lax.stop_gradient(jnp.maximum(data_time - place.right, 0))  # at a jump time: before it
    return jnp.where(is_data, data_time + (start - lax.stop_gradient(start)), left), is_data


def _add_data(backward: BackwardPass, mode, tried: TriedStep, carried, samples_left):
    """psi- = psi+ + c_x at a data time. Where the step that came there has taken it along, in a second derivative, c_x
    is carried back to where the step ends."""
    if backward.cotangent.samples is None or backward.ts is None:
        return *carried, samples_left
    (total, psi), place = carried, jnp.maximum(samples_left - 1, 0)
    c_x = jnp.where(tried.is_data, backward.cotangent.samples[place], 0)
    by_parameters, by_state = pull_in_no_time(
        backward.system, backward.step_parameter_mask, (tried.left, backward.ts[place]), tried.x, mode, c_x
    )
    total = jax.tree.map(jnp.add, total, pack(by_parameters))
    return total, psi + c_x + by_state, samples_left - tried.is_data


def _judge(backward: BackwardPass, x, at: BackwardState, step: StepBack, h, width):
    """Whether a step back resolves what it carries, the longest step to try next, the size of psi and its largest."""
    if step.psi_error is None or step.total_error is None:  # nothing is judged, and the size of psi is not asked for
        return jnp.array(True), width, at.peak, at.peak
    control = backward.control
    ratio, size = control.of_costate(x, at.psi, step.psi, step.psi_error, at.peak)
    peak = jnp.maximum(at.peak, size)  # a sweep's first step knows no other

    def of_gradient():
        scale = jax.tree.map(jnp.maximum, at.gathered, at.least_scale).unpack()
        return control.of_gradient(backward.step_parameters, scale, step.total_error.unpack(), peak)

    looks = at.judges_gradient & ~is_noise(size, peak)
    ratio = jnp.maximum(ratio, lax.cond(looks, of_gradient, lambda: jnp.zeros_like(ratio)))
    return *control.judge(ratio, h, width), size, peak
