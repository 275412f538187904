"""The front door: a scene and a state in, the motion out, ready to be differentiated."""

import warnings
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .adjoint.methods import AbstractGradientMethod, Replay
from .mechanics.checks import check_room, check_shapes, real_array, real_tolerance
from .mechanics.clearance import warn_of_sampled_gaps
from .mechanics.closures import lift_closures
from .mechanics.mode import default_capture_speed, open_mode
from .mechanics.scene import AbstractScene, State
from .mechanics.system import MechanicalSystem
from .solve import Inputs, Method, Reported, Setting, solve
from .status import Status
from .trajectory import Events, SimulationError, Steps, Trajectory


def simulate(
    scene: AbstractScene,
    state: State,
    *,
    t0: float | Array = 0.0,
    t1: float | Array,
    ts: Float[Array, "sample"] | None = None,
    running_cost: Callable[..., Any] | None = None,
    solver: diffrax.AbstractSolver | None = None,
    rtol: float | Array = 1e-8,
    atol: float | Array = 1e-8,
    max_events: int = 256,
    max_steps: int = 4096,
    max_step: float | Array | None = None,
    capture_speed: float | None = None,
    adjoint: AbstractGradientMethod | None = None,
    throw: bool = True,
) -> Trajectory:
    """Motion of a scene from t0 to t1 through impacts, captures and releases, with its exact gradient.

        M(q) v' = F(t, q, v) + G lambda,   0 <= lambda _|_ Phi(t, q) >= 0,   Newton's law at impacts     (1.1)-(1.7)

    Write the cost J in plain JAX on what is returned; `eqx.filter_grad(J)(scene)` is then dJ/d(scene), with the
    adjoint's jump conditions (T8)-(T10) applied at every event. Gradients reach the leaves of the scene and of the
    running cost, the initial state, t0, t1 and ts, under `jax.jit` and `jax.vmap` in any order.

    Arguments:

    - `scene`: what moves; its array leaves are the parameters.
    - `state`: initial q (dof,) and v (dof,). Contacts with gap 0 and rate 0 start closed if they are pressed together.
    - `t0`, `t1`: horizon [s], t1 > t0.
    - `ts`: sorted times in [t0, t1] at which states are wanted; at an event's time, the state after it.
    - `running_cost`: `running_cost(scene, t, q, v)`, a scalar or a PyTree; its integral comes back as `.cost`. It is
      integrated as part of the state, under the same error control.
    - `solver`: any Diffrax solver with an error estimate; `diffrax.Tsit5()` by default. Explicit ones are run with
      stages of our own.
    - `rtol`, `atol`: tolerances of the error control per step.
    - `max_events`, `max_steps`: room for events, and for steps tried; the record takes memory for both.
    - `max_step`: longest step [s]. Dips of a gap inside a step are searched for by bounds, however short; only a gap
      that is read from a table or made by a loop is sampled instead, at 16 places of a step or more: for such a one
      give the time that its shortest dip lasts.
    - `capture_speed`: a rebound slower than this, relative to the fastest impact of its contact, ends a cascade of
      impacts: the contact stays closed. The error of cutting at speed w is O(w^3). Default: eps^(1/3), 6e-6 in float64.
    - `adjoint`: `Replay()` (default) or another gradient method: `Replay(recompute=True)` for memory,
      `ForwardSensitivities()` for forward mode, `ContinuousCostate()` and `DiffraxAdjoint()` to compare.
    - `throw`: raise if the motion does not reach t1; with False, look at `.status` (per lane of a batch).

    Raises: ValueError or TypeError for what does not fit (shapes, types); `SimulationError` for what only the values
    show.
    """
    t0, t1, ts, state = _as_arrays(t0, t1, ts, state)
    max_step = None if max_step is None else real_tolerance("max_step", max_step)
    rtol, atol = real_tolerance("rtol", rtol), real_tolerance("atol", atol)
    _check_settings(max_events, max_steps, solver, adjoint, capture_speed, throw)
    check_shapes(scene, state, running_cost)
    scene, running_cost = lift_closures(scene, running_cost, t0, state)
    dtype = state.q.dtype
    adjoint = adjoint or Replay()
    room = max_events, max_steps, _segment_steps(adjoint, ts), max_step
    check_room(max_events, room[2] or max_steps, state)
    method = Method(solver or diffrax.Tsit5(), *_tolerances(rtol, atol, dtype), *room)
    capture_speed = default_capture_speed(dtype) if capture_speed is None else float(capture_speed)
    system = MechanicalSystem(scene, running_cost, capture_speed, state.q.shape[0], (method.rtol, method.atol))
    trajectory = _simulate(system, state, t0, t1, ts, method, adjoint)
    return _raise_unless_successful(trajectory) if throw else trajectory


@eqx.filter_jit
def _simulate(system: MechanicalSystem, state: State, t0, t1, ts, method: Method, adjoint) -> Trajectory:
    if method.max_step is None:
        warn_of_sampled_gaps(system.scene, t0, state.q)
    cost_shape = None
    running_cost = system.running_cost
    if running_cost is not None:
        cost_shape = jax.eval_shape(lambda: running_cost(system.scene, t0, state.q, state.v))
    z = jnp.zeros(sum(leaf.size for leaf in jax.tree.leaves(cost_shape)), state.q.dtype)
    x0 = jnp.concatenate([state.q, state.v, z])
    mode = open_mode(jax.eval_shape(system.scene.gap, t0, state.q).shape[0], state.q.dtype)
    setting = Setting(mode, _horizon_status(t0, t1, ts, method), method)
    reported = solve(Inputs(system, x0, t0, t1, ts), setting, adjoint)
    return _trajectory(system, ts, reported, cost_shape)


def _horizon_status(t0, t1, ts, method: Method) -> Status:
    """Whether times and tolerances fit; what depends on the scene is looked at where the motion begins."""
    positive = (jnp.asarray(method.rtol) > 0) & (jnp.asarray(method.atol) > 0)
    status = Status.where(positive, Status.running, Status.bad_tolerance)
    if ts is not None and ts.shape[0] > 0:
        sorted_inside = jnp.all(ts[1:] >= ts[:-1]) & (ts[0] >= t0) & (ts[-1] <= t1)
        status = Status.where(sorted_inside, status, Status.unsorted_times)
    status = Status.where((t1 > t0) & jnp.isfinite(t1 - t0), status, Status.bad_horizon)
    return status


def _trajectory(system: MechanicalSystem, ts, reported: Reported, cost_shape) -> Trajectory:
    happened = jnp.arange(reported.time.shape[0]) < reported.count
    q, v, z = system.split(reported.final)
    before, after = (State(*system.split(x)[:2]) for x in (reported.before, reported.after))
    kind = jnp.where(happened, reported.kind, -1)
    impulse, closing_speed = reported.emitted
    events = Events(reported.time, kind, reported.guard, before, after, impulse, closing_speed, reported.count)
    samples = (None, None) if reported.samples is None else system.split(reported.samples)[:2]
    return Trajectory(
        ts, *samples, State(q, v), _unravel(z, cost_shape), events, reported.mode.active, reported.status,
        Steps(reported.accepted, reported.rejected),
    )  # fmt: skip


def _unravel(z, cost_shape):
    leaves, tree = jax.tree.flatten(cost_shape)
    sizes = [leaf.size for leaf in leaves]
    places = [sum(sizes[:i]) for i in range(len(sizes))]
    parts = [z[p : p + leaf.size].reshape(leaf.shape) for p, leaf in zip(places, leaves, strict=True)]
    return tree.unflatten(parts)


def _as_arrays(t0, t1, ts, state):
    if not isinstance(state, State):
        raise TypeError(f"`state` must be a hybridsens.State, but is {type(state).__name__}: use State(q, v).")
    dtype = jnp.result_type(state.q, state.v)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise TypeError(f"The state must be real, but has type {dtype}.")
    t0, t1 = (real_array(name, t, 0).astype(dtype) for name, t in (("t0", t0), ("t1", t1)))
    ts = None if ts is None else real_array("ts", ts, 1).astype(dtype)
    return t0, t1, ts, State(state.q.astype(dtype), state.v.astype(dtype))


def _check_settings(max_events, max_steps, solver, adjoint, capture_speed, throw):
    for name, value in (("max_events", max_events), ("max_steps", max_steps)):
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise ValueError(f"`{name}` must be an integer >= 1, but is {value!r}.")
    if solver is not None and not isinstance(solver, diffrax.AbstractAdaptiveSolver):
        raise TypeError(f"`solver` must be a Diffrax solver with an error estimate, but is {type(solver).__name__}.")
    if adjoint is not None and not isinstance(adjoint, AbstractGradientMethod):
        raise TypeError(
            f"`adjoint` must be a gradient method such as hybridsens.Replay(), but is {type(adjoint).__name__}."
        )
    if not isinstance(throw, bool):
        raise TypeError(f"`throw` must be True or False, but is {throw!r}.")
    if capture_speed is not None and (not isinstance(capture_speed, int | float) or not 0 <= capture_speed < 1):
        raise ValueError(f"`capture_speed` must lie in [0, 1), but is {capture_speed!r}.")


def _tolerances(rtol, atol, dtype):
    """Tolerances that the floating point type can meet."""
    if isinstance(rtol, jax.Array) or isinstance(atol, jax.Array):
        return rtol, atol
    finest = 16 * float(jnp.finfo(dtype).eps)
    atol = max(atol, float(jnp.finfo(dtype).tiny) ** 0.5)  # the error norm squares an error over it
    if rtol < finest or (atol < finest and dtype == jnp.float32):
        warnings.warn(
            f"Tolerances below {finest:.1e} are beyond {dtype} and are raised to it. "
            "For double precision call `hybridsens.configure(x64=True)` before JAX starts.",
            stacklevel=3,
        )
        return max(rtol, finest), max(atol, finest) if dtype == jnp.float32 else atol
    return rtol, atol


def _segment_steps(adjoint, ts) -> int | None:
    """Room for the steps of a segment where they are not recorded."""
    if not isinstance(adjoint, Replay) or not adjoint.recompute:
        return None
    if ts is not None:
        raise ValueError("`ts` needs recorded steps, which Replay(recompute=True) does not keep: use Replay().")
    return adjoint.segment_steps


def _raise_unless_successful(trajectory: Trajectory) -> Trajectory:
    status = jax.tree.map(_without_tangent, trajectory.status)
    failed = status != Status.successful
    if isinstance(failed, jax.core.Tracer):
        return status.error_if(trajectory, failed)
    if failed:
        raise SimulationError(f"The motion did not reach its end: {Status[status]}")
    return trajectory


@jax.custom_jvp
def _without_tangent(number):
    """An integer that a check may look at in the middle of differentiation (checks have no rule for its empty
    tangent)."""
    return number


@_without_tangent.defjvp
def _without_tangent_jvp(primals, tangents):
    del tangents
    return primals[0], np.zeros(jnp.shape(primals[0]), jax.dtypes.float0)
