"""A hybrid system's motion with its exact gradient: the segment loop, and the backward pass as its custom VJP."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .adjoint.backward import Cotangents, pull_back
from .adjoint.forward_sensitivity import push_forward
from .adjoint.methods import AbstractGradientMethod, ForwardSensitivities, Replay
from .adjoint.segment_steps import recomputed_steps, recorded_steps
from .adjoint.step_adjoint import step_adjoint
from .batching import map_lanes_on_cpu
from .forward.method import Method
from .forward.record import Motion, empty_motion
from .forward.sampling import sample_states
from .forward.segment_loop import run_segments
from .forward.solver import FlowSize, flow_size
from .hybrid import AbstractHybridSystem, Mode
from .one_kernel import in_one_kernel
from .packed import Packed, pack
from .status import Status
from .traced_once import TracedOnce


class Inputs(NamedTuple):
    """Everything that a motion is differentiated by."""

    system: AbstractHybridSystem
    x0: Float[Array, "state"]
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    ts: Float[Array, "sample"] | None


class Setting(NamedTuple):
    """Everything else that a motion depends on."""

    mode: Mode
    """The mode to begin in; what a system that chooses its own is given to choose from."""
    status: Status
    """`Status.running`, or why the motion must not start."""
    method: Method


class _How(NamedTuple):
    """How to go back: by which method, and whether the ends of the horizon are differentiated by."""

    adjoint: AbstractGradientMethod
    by_t0: bool
    by_t1: bool


class Reported(NamedTuple):
    """Everything that is reported of a motion. Rows of events beyond `count` are padding."""

    final: Float[Array, "state"]
    samples: Float[Array, "sample state"] | None
    time: Float[Array, "event"]
    before: Float[Array, "event state"]
    after: Float[Array, "event state"]
    emitted: Any
    guard: Int[Array, "event"]
    kind: Int[Array, "event"]
    count: Int[Array, ""]
    mode: Mode
    status: Status
    accepted: Int[Array, ""]
    rejected: Int[Array, ""]


def solve(inputs: Inputs, setting: Setting, adjoint: AbstractGradientMethod | None = None) -> Reported:
    """Motion of a hybrid system from (t0, x0) to t1, differentiable in all of `inputs`.

    With `Replay()` in reverse mode (and forward over reverse), with `ForwardSensitivities()` in forward mode.
    """
    inputs = inputs._replace(system=TracedOnce(inputs.system))
    # JAX traces the rule below under the mesh that it finds, named; were it not named here, all would be traced twice.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        if isinstance(adjoint, ForwardSensitivities):
            return _forward(inputs, setting)[0]
        return _solve_in_reverse(inputs, setting, adjoint or Replay())


@eqx.filter_custom_vjp
def _solve_in_reverse(inputs: Inputs, setting: Setting, adjoint: AbstractGradientMethod) -> Reported:
    del adjoint
    return _forward(inputs, setting)[0]


@_solve_in_reverse.def_fwd
def _solve_fwd(perturbed, inputs, setting, adjoint):
    del perturbed, adjoint
    return _forward(inputs, setting)


@_solve_in_reverse.def_bwd
def _solve_bwd(motion, reported_bar, perturbed, inputs, setting, adjoint):
    how = _How(adjoint, perturbed.t0, perturbed.t1)
    return _backward(inputs, setting, motion, reported_bar, how)


@eqx.filter_custom_jvp
def _run(inputs: Inputs, setting: Setting) -> Motion:
    """The forward pass; its derivative rule in forward mode is the push-forward of variations."""
    system, x0, t0, t1, _ = inputs
    stepper = setting.method.stepper(_flow_size(inputs, setting))
    method = setting.method
    room = method.max_events, method.max_steps if method.segment_steps is None else 0
    motion = empty_motion(system, t0, x0, setting.mode, *room, setting.status)
    return run_segments(system, stepper, t1, motion)


@_run.def_jvp
def _run_jvp(primals, tangents):
    inputs, setting = primals
    if setting.method.segment_steps is not None:
        raise NotImplementedError(
            "Forward mode and second derivatives need recorded steps, which Replay(recompute=True) does not keep: use "
            "Replay() or ForwardSensitivities()."
        )
    motion = _run(inputs, setting)
    parameters, static = eqx.partition(inputs.system, eqx.is_inexact_array)
    d_inputs = tangents[0]
    d_parameters = _filled(parameters, eqx.filter(d_inputs.system, eqx.is_inexact_array))
    d_ends = tuple(_filled(p, d) for p, d in zip(inputs[1:4], d_inputs[1:4], strict=True))
    start = (inputs.t0, inputs.x0)
    solver = setting.method.replay_solver(_flow_size(inputs, setting))
    d = push_forward(parameters, static, solver, motion, start, inputs.t1, (d_parameters, *d_ends))
    nothing = jax.tree.map(lambda leaf: jnp.zeros_like(leaf) if eqx.is_inexact_array(leaf) else None, motion)
    moved = lambda m: (m.x, m.steps.t, m.steps.x, m.events.time, m.events.before, m.events.after, m.events.emitted)
    d_moved = (d.final, d.grid_t, d.grid_x, d.time, d.before, d.after, d.emitted)
    return motion, eqx.tree_at(moved, nothing, d_moved)


def _flow_size(inputs: Inputs, setting: Setting) -> FlowSize:
    return flow_size(inputs.system, setting.mode, inputs.t0, inputs.x0)


def _filled(primal, tangent):
    """Tangents with zeros where nothing moves."""
    fill = lambda p, t: jnp.zeros_like(p) if t is None and p is not None else t
    return jax.tree.map(fill, primal, tangent, is_leaf=lambda leaf: leaf is None)


def _forward(inputs: Inputs, setting: Setting) -> tuple[Reported, Packed]:
    """Report and full record. A CPU's batch keeps no records: `_backward` runs its lanes again."""
    dynamic, static = eqx.partition((inputs, setting), eqx.is_array)
    room = setting.method.max_events
    go = lambda dynamic: _forward_lane(*eqx.combine(dynamic, static))

    def lane(dynamic):
        motion, samples = go(dynamic)
        return _report(motion, samples, room), pack((motion, samples))

    def alone(dynamic):
        packed = in_one_kernel(go)(dynamic)
        motion, samples = packed.unpack()
        return _report(motion, samples, room), packed

    return map_lanes_on_cpu(lane, alone)(dynamic)


@eqx.filter_jit  # traced for the value and again for its gradient: the second time it is looked up
def _forward_lane(inputs: Inputs, setting: Setting) -> tuple[Motion, Float[Array, "sample state"] | None]:
    """A motion and its samples."""
    motion = _run(inputs, setting)
    if inputs.ts is None:
        return motion, None
    solver = setting.method.replay_solver(_flow_size(inputs, setting))
    samples = sample_states(inputs.system, solver, motion, inputs.ts, forward_mode=True)  # `_sample_vjp` goes back
    reached = inputs.ts <= motion.t
    return motion, jnp.where(reached[:, None], samples, jnp.nan)  # one that broke off has no states further on


def _backward(inputs: Inputs, setting: Setting, record: Packed, reported_bar: Reported, how: _How) -> Inputs:
    """Cotangents of the inputs from those of the report (None where nothing depends on an entry)."""
    dynamic, static = eqx.partition((inputs, setting), eqx.is_array)

    def go_back(dynamic, motion, bar):
        inputs, setting = eqx.combine(dynamic, static)
        return _backward_lane(inputs, setting, motion, bar, how)

    def lane(dynamic, record, bar):
        return go_back(dynamic, record.unpack()[0], bar), None

    def alone(dynamic, record, bar):
        return in_one_kernel(lambda *given: lane(*given)[0])(dynamic, record, bar).unpack(), None

    def lane_of_batch(batched, dynamic, record, bar):
        inputs_batched, record_batched, _ = batched
        if inputs_batched and not record_batched:
            motion, _ = _forward_lane(*eqx.combine(dynamic, static))
            return go_back(dynamic, motion, bar), None
        return lane(dynamic, record, bar)

    return map_lanes_on_cpu(lane, alone, lane_of_batch)(dynamic, record, reported_bar)[0]


def _backward_lane(inputs: Inputs, setting: Setting, motion: Motion, bar: Reported, how: _How) -> Inputs:
    parameters, static = eqx.partition(inputs.system, eqx.is_inexact_array)
    replay = setting.method.replay_solver(_flow_size(inputs, setting))
    grid, ts_bar, sampled = None, None, None
    if bar.samples is not None:
        sampled, grid, ts_bar = _sample_vjp(parameters, static, replay, motion, inputs.ts, bar.samples)
    final = jnp.zeros_like(motion.x) if bar.final is None else bar.final
    cotangents = Cotangents(final, bar.time, bar.before, bar.after, bar.emitted, grid)
    start = (inputs.t0, inputs.x0)
    carry_back = step_adjoint(how.adjoint, replay)
    ends = (how.by_t0, how.by_t1)
    find_steps = recorded_steps
    if setting.method.segment_steps is not None:
        stepper = setting.method.stepper(_flow_size(inputs, setting))
        find_steps = partial(recomputed_steps, inputs.system, stepper, start, inputs.t1)
    gradient = pull_back(parameters, static, carry_back, find_steps, motion, start, inputs.t1, cotangents, ends)
    by_parameters = gradient.parameters
    if sampled is not None:
        by_parameters = jax.tree.map(jnp.add, by_parameters, sampled)
    return Inputs(by_parameters, gradient.x0, gradient.t0, gradient.t1, ts_bar)


def _sample_vjp(parameters, static, solver, motion: Motion, ts, samples_bar):
    """Cotangents that samples pass on: to the parameters, to the recorded grid, to their times."""

    def sample(parameters, grid_t, grid_x, ts):
        grid = eqx.tree_at(lambda m: (m.steps.t, m.steps.x), motion, (grid_t, grid_x))
        return sample_states(eqx.combine(parameters, static), solver, grid, ts)

    _, vjp = jax.vjp(sample, parameters, motion.steps.t, motion.steps.x, ts)
    by_parameters, grid_t, grid_x, by_ts = vjp(samples_bar)
    return by_parameters, (grid_t, grid_x), by_ts


def _report(motion: Motion, samples: Float[Array, "sample state"] | None, room: int) -> Reported:
    events = motion.events
    cut = lambda rows: jax.tree.map(lambda leaf: leaf[:room], rows)
    return Reported(
        motion.x, samples, cut(events.time), cut(events.before), cut(events.after), cut(events.emitted),
        cut(events.guard), cut(events.decision.kind), events.count, motion.mode, motion.status,
        motion.steps.count, motion.rejected,
    )  # fmt: skip
