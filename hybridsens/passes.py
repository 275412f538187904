"""One motion: its forward pass, its backward pass, and what both become in forward mode."""

import dataclasses
import math
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .adjoint.backward import pull_back
from .adjoint.control import DerivativeControl
from .adjoint.forward_sensitivity import ForwardPass, push_forward
from .adjoint.methods import AbstractGradientMethod
from .adjoint.segment_steps import Rerun, recomputed_steps, recorded_steps
from .adjoint.step import step_parameter_mask
from .adjoint.steps_back import BackwardPass
from .flat_system import AbstractFlatSystem, Mode
from .forward.flow_jumps import told_of_flow_jumps
from .forward.record import Motion, empty_motion, first_moment
from .forward.sampling import past_coincidences, sample_rates, sample_states
from .forward.segment_loop import run_segments
from .forward.solver import TERM, FlowSize, RunSettings, flow_size
from .numerics.batch_axes import batch_in_front
from .observables import Observables, filled
from .reported import in_rows_recorded, report
from .status import Status


class Problem(NamedTuple):
    """Everything that a motion is differentiated by."""

    system: AbstractFlatSystem
    x0: Float[Array, "state"]
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    ts: Float[Array, "sample"] | None
    out_of_steps: Float[Array, ""]
    """A mark, 0. Its cotangent is 1 where reverse mode ran out of steps: so the news leaves a compiled program,
    which may not raise."""


class Options(NamedTuple):
    """Everything else that a motion depends on."""

    mode: Mode
    """The mode to begin in; what a system that chooses its own is given to choose from."""
    status: Status
    """`Status.running`, or why the motion must not start."""
    settings: RunSettings
    known_jumps: bool = False
    """Whether jumps of flow and guards that no event tells of are known to do no harm."""
    differentiated: bool = False
    """Whether a derivative is taken, so that what spoils it must be told."""


class BackwardOptions(NamedTuple):
    """How to go back: by which method, and whether the ends of the horizon are differentiated by."""

    adjoint: AbstractGradientMethod
    t0_perturbed: bool
    t1_perturbed: bool


@eqx.filter_jit  # in a batch it is traced for an element and for its way back: looked up then
def go_forward(problem: Problem, options: Options) -> tuple[Motion, Float[Array, "sample state"] | None]:
    """A motion and its samples, None where none are asked for."""
    problem = _past_start(problem)
    motion = _forward_pass(problem, options)
    return motion, _samples(problem, options, motion)


def _past_start(problem: Problem) -> Problem:
    """The problem as it begins behind a jump time at t0: what the flow was before that is not asked."""
    return problem._replace(t0=first_moment(problem.system, problem.t0))


def _forward_pass(problem: Problem, options: Options) -> Motion:
    motion = _motion(problem, options._replace(known_jumps=False, differentiated=False))
    if options.known_jumps:
        return dataclasses.replace(motion, status=motion.status.without_jumps)
    if not options.differentiated or options.settings.segment_steps is not None:
        return motion  # one that is not recorded is told of where its steps are run again
    settings = options.settings
    return told_of_flow_jumps(problem.system, settings.atol / settings.rtol, motion)


@eqx.filter_jit  # JAX traces the motion by itself before that of a derivative: looked up then
def _motion(problem: Problem, options: Options) -> Motion:
    system, x0, t0, t1, *_ = problem
    settings = options.settings
    stepper = settings.stepper(_flow_size(problem, options))
    room = settings.max_events, settings.max_steps if settings.segment_steps is None else 0
    motion = empty_motion(system, t0, x0, options.mode, *room, options.status)
    return run_segments(system, stepper, t1, motion)


def _samples(problem: Problem, options: Options, motion: Motion):
    if problem.ts is None:
        return None
    solver = options.settings.replay_solver(_flow_size(problem, options))
    ts = past_coincidences(problem.system, motion, problem.ts)
    samples = sample_states(problem.system, solver, motion, ts)
    return jnp.where(_reached(ts, motion), samples, jnp.nan)


def _reached(ts, motion: Motion):
    """Which samples a motion has come to: one that broke off has no states further on, and no derivatives of them."""
    return (ts <= motion.t)[:, None]


def _flow_size(problem: Problem, options: Options) -> FlowSize:
    return flow_size(problem.system, options.mode, problem.t0, problem.x0)


def vary_forward(problem: Problem, options: Options, motion: Motion, d_problem: Problem) -> Observables:
    """Tangent of what is observed of a motion (T6). It may take shorter steps than the motion; the values stay those of
    the motion, as `jax.linearize` asks."""

    def observed(problem):
        followed, out_of_steps = _follow(problem, options, motion)
        reported = report(followed, _samples(problem, options, followed), options.settings.max_events)
        return reported.observed._replace(out_of_steps=out_of_steps)

    return eqx.filter_jvp(observed, (problem,), (d_problem,))[1]


@eqx.filter_custom_jvp
def _follow(problem: Problem, options: Options, motion: Motion) -> tuple[Motion, Float[Array, ""]]:
    """The motion itself, with a derivative by the problem: that of `push_forward`, on the steps that its tangent takes.
    So what plain JAX makes of the motion is differentiated correctly. And the mark of a derivative that ran out of
    steps."""
    del options
    return batch_in_front(motion), problem.out_of_steps


@_follow.def_jvp
def _follow_jvp(primals, tangents):
    problem, options, motion = primals
    problem = _past_start(problem)
    if options.settings.segment_steps is not None:
        raise NotImplementedError(
            "Forward mode and second derivatives need recorded steps, which Replay(recompute=True) does not keep: use "
            "Replay() or ForwardSensitivities()."
        )
    motion, mark = _follow(problem, options, motion)  # where differentiated again, by the derivative around it
    d_problem = tangents[0]
    d_system = filled(eqx.filter(problem.system, eqx.is_inexact_array), d_problem.system)
    d_ends = tuple(filled(p, d) for p, d in zip(problem[1:4], d_problem[1:4], strict=True))
    solver = options.settings.replay_solver(_flow_size(problem, options))
    forward = ForwardPass(problem.system, d_system, solver, _control(options.settings, solver))
    motion, d, out_of_steps = push_forward(forward, motion, (problem.t0, problem.x0), problem.t1, d_ends)
    nothing = jax.tree.map(lambda leaf: jnp.zeros_like(leaf) if eqx.is_inexact_array(leaf) else None, motion)
    moved = lambda m: (m.t, m.x, m.steps.t, m.steps.x, m.events.states)
    d_motion = eqx.tree_at(moved, nothing, (d.end, d.final, d.steps_t, d.steps_x, d.events))
    return (batch_in_front(motion), mark), (d_motion, out_of_steps.astype(mark.dtype) + mark)


def go_back(
    problem: Problem, options: Options, backward_options: BackwardOptions, motion: Motion, cotangent: Observables
) -> Problem:
    """Cotangents of the problem from those of what is reported of its motion."""
    problem = _past_start(problem)
    motion, mark = _follow(problem, options, motion)  # for forward over reverse
    backward = _backward_pass(problem, options, backward_options.adjoint, motion, cotangent)
    perturbed_ends = backward_options.t0_perturbed, backward_options.t1_perturbed
    initial = problem.t0, problem.x0
    by_system, by_x0, by_t0, by_t1, out_of_steps = pull_back(backward, motion, initial, problem.t1, perturbed_ends)
    by_ts = _by_sample_times(problem, backward, motion)
    return Problem(by_system, by_x0, by_t0, by_t1, by_ts, out_of_steps.astype(mark.dtype) + mark)


def _backward_pass(problem: Problem, options: Options, adjoint, motion: Motion, cotangent: Observables) -> BackwardPass:
    """What the backward pass is made from. Samples that the motion has not come to have no cotangents."""
    settings, system = options.settings, problem.system
    replay = settings.replay_solver(_flow_size(problem, options))
    final, samples, ts = filled(motion.x, cotangent.final), cotangent.samples, None
    if samples is not None and problem.ts is not None:
        ts = past_coincidences(system, motion, problem.ts)
        samples = jnp.where(_reached(ts, motion), samples, 0)
    by_rows = Observables(final, samples, in_rows_recorded(motion, settings.max_events, cotangent.events), None)
    controlled = settings.derivative_rtol != math.inf
    control = _control(settings, replay)
    mask = step_parameter_mask(system, options.mode, problem.t1, motion.x)
    find_steps = recorded_steps
    if settings.segment_steps is not None:
        stepper = settings.stepper(_flow_size(problem, options))
        least_state = None if options.known_jumps else settings.atol / settings.rtol
        rerun = Rerun(system, stepper, (problem.t0, problem.x0), problem.t1, least_state)
        find_steps = partial(recomputed_steps, rerun)
    return BackwardPass(system, mask, adjoint, replay, controlled, control, by_rows, ts, find_steps)


def _by_sample_times(problem: Problem, backward: BackwardPass, motion: Motion):
    """Cotangents of the times asked for, by which a sample moves along the flow; None where there are none."""
    ts, cotangents = backward.ts, backward.cotangent.samples
    if ts is None or cotangents is None:
        return None
    return jnp.sum(sample_rates(problem.system, backward.solver, motion, ts) * cotangents, axis=1)


def _control(settings: RunSettings, solver) -> DerivativeControl:
    """What a derivative may be off by in a step.

    The embedded estimate is of lower order than the step: where a step just meets `rtol`, the estimate for its
    derivative is some 100 times that. At rough tolerances it is less, hence the cap."""
    rtol = settings.derivative_rtol
    if rtol is None:
        rtol = jnp.minimum(100 * settings.rtol, jnp.maximum(1e-5, settings.rtol))
    order = float(solver.error_order(TERM) or 2)
    return DerivativeControl(rtol, settings.atol / settings.rtol, order, 4 * settings.max_steps)
