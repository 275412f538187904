"""The entry point: a scene and a state in, the motion out, ready to be differentiated."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, Literal

import diffrax
import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Float

from .adjoint.methods import AbstractGradientMethod, Replay
from .border import entering, leaving
from .differentiable import differentiable_motion
from .forward.solver import RunSettings
from .located.system import own_mode
from .mechanics.checks import check_kinds, check_shapes, may_end
from .mechanics.condensed import condensed
from .mechanics.decisions import mode_before_any
from .mechanics.event_table import shown_by_values
from .mechanics.events import blank_event
from .mechanics.located import located, own_scene
from .mechanics.mass import with_known_mass
from .mechanics.mode import ContactMode, SwitchedMode, default_capture_speed
from .mechanics.scene import AbstractScene, State
from .mechanics.smoothness import warn_of_discontinuities
from .mechanics.switched import SwitchedSystem
from .mechanics.switches import AbstractSwitchedScene, check_mode, check_switches, in_mode, switch_rules, warn_of_switch
from .mechanics.system import MechanicalSystem
from .mechanics.trajectory import Trajectory
from .mechanics.wrapped import TypedScene, lift_closures
from .numerics.fixed import Fixed, number
from .numerics.shapes import Shapes
from .outcome import Steps, raise_unless_times_fit, seen
from .passes import Options, Problem
from .reported import Reported, end_of, where_in_doubt
from .settings import check_method, declared_jump_times, horizon_status, run_settings
from .system_checks import mode_as_arrays
from .until import checked_until
from .validation.arguments import check_mesh, in_type, real_array
from .validation.numbers import told_of_constants
from .validation.same_function import same_function
from .waiting import waiting


def simulate(
    scene: AbstractScene,
    state: State,
    mode: Any = None,
    *,
    t0: float | Array = 0.0,
    t1: float | Array,
    ts: Float[Array, "sample"] | None = None,
    jump_ts: Float[Array, "jump"] | None = None,
    running_cost: Callable[..., Any] | None = None,
    until: Callable[..., Any] | None = None,
    solver: diffrax.AbstractSolver | None = None,
    rtol: float | Array = 1e-8,
    atol: float | Array = 1e-8,
    max_events: int = 256,
    max_steps: int = 4096,
    max_step: float | Array | None = None,
    capture_speed: float | Array | None = None,
    adjoint: AbstractGradientMethod | None = None,
    throw: bool | Literal["nan"] = True,
    progress: bool = False,
) -> Trajectory:
    """Motion of a scene from t0 to t1 through impacts, captures and releases, with its exact gradient.

        M(q) v' = F(t, q, v) + G lambda,   0 <= lambda _|_ Phi(t, q) >= 0,   Newton's law at impacts     (1.1)-(1.7)

    Write the cost J in plain JAX on what is returned; `eqx.filter_grad(J)(scene)` is then dJ/d(scene), with the
    adjoint's jump conditions (T8)-(T10) applied at every event. Gradients reach the leaves of the scene and of the
    running cost, the initial state, t0, t1 and ts, under `jax.jit` and `jax.vmap` in any order.

    Arguments:

    - `scene`: what moves; its array leaves are the parameters.
    - `state`: initial q (dof,) and v (dof,). Contacts with gap 0 and rate 0 start closed if they are pressed together.
    - `mode`: initial mode of an `AbstractSwitchedScene`, any PyTree of arrays or numbers; None for other scenes.
    - `t0`, `t1`: horizon [s], t1 > t0.
    - `ts`: sorted times in [t0, t1] at which states are wanted; at an event's time, the state after it.
    - `jump_ts`: times at which a force or a running cost has a kink or a jump, or a gap a kink: knots of a control,
      switching times, pulses; in any order. Those outside of the horizon do not matter. Steps end there, so that both
      sides are integrated to tolerance, and gradients reach these times. Two that coincide count as one, and a
      derivative by the time goes to the first of them. Default: `scene.jump_times()`.
    - `running_cost`: `running_cost(scene, t, q, v)`, a scalar or a PyTree; its integral comes back as `.cost`. It is
      integrated as part of the state, under the same error control. That of a scene with switches is given the mode
      as a fifth argument.
    - `until`: `until(scene, event)`, a boolean: the motion ends with the first event for which it is True, or at t1.
      `event` is one row of `.events`, whose `count` is how many events there have been with it. `.final`, `.cost` and
      `.end_time` are then those of that event and move with it in derivatives; samples at later times are nan.
    - `solver`: any Diffrax solver of one term with an error estimate (KenCarp's have two); default `diffrax.Tsit5()`.
      Explicit ones are run with stages of our own.
    - `rtol`, `atol`: tolerances of the error control per step. Other values do not compile anew.
    - `max_events`, `max_steps`: room for events, and for steps tried; the record takes memory for both.
    - `max_step`: longest step [s]. Dips of a gap or a switch inside a step are searched for by bounds, however short;
      only one made by an operation without known bounds (a table, a loop, a special function) is sampled instead, at
      16 places of a step or more, and a warning says so: for such a one give the time that its shortest dip lasts.
    - `capture_speed`: a rebound slower than this, relative to the fastest impact of its contact, ends a cascade of
      impacts: the contact stays closed. The error of cutting at speed w is O(w^3), of a cascade over several
      contacts O(w). Default: eps^(1/3), 6e-6 in float64.
    - `adjoint`: `Replay()` (default) or another gradient method: `Replay(recompute=True)` for memory,
      `ForwardSensitivities()` for forward mode, `ContinuousCostate()` and `DiffraxAdjoint()` to compare.
    - `throw`: raise unless the motion is successful: also where it reaches t1 but its derivatives are not to be trusted
      (`grazing`, `guard_jumps`; `flow_jumps`, which is looked for where a derivative is taken, and by
      `ForwardSensitivities()` always); with False, look at `.status` (one each in a batch). A motion that broke off
      returns the state where it did, with the gradient of the state at that instant, held fixed: one that could not
      begin returns the state at t0, whose gradient by the scene is 0, which an optimiser takes for a stationary
      point. `.end_time` tells when it ended. "nan" makes value and gradient of it nan instead, that time too.
    - `progress`: show for how long it compiles and runs.

    All is computed in the type of the state. Leaves of another type are cast to it, and their gradients back.

    Raises: ValueError or TypeError for what does not fit (shapes, types), and for a derivative in a mode that `adjoint`
    does not serve; `SimulationError` for what only the values show, and for a derivative that runs out of steps. A
    compiled program cannot raise an exception of its caller's choice: from `jax.jit` or `eqx.filter_jit` a
    `SimulationError` arrives as `jax.errors.JaxRuntimeError`, or as ValueError where the program ran on in the
    background, with its text as the last line. A program that raises cannot be exported by `jax.export`
    (NotImplementedError): use `throw=False` or "nan" there. `jax.shard_map` needs `check_vma=False`, and a batch that
    is placed on several devices a mesh with automatic axes.
    """
    written, running_cost = scene, same_function(running_cost)
    asked = dict(
        solver=solver, rtol=rtol, atol=atol, max_events=max_events, max_steps=max_steps, max_step=max_step,
        capture_speed=capture_speed,
    )  # fmt: skip
    again = functools.partial(  # the same call for other `ts`
        simulate, scene, state, mode, t0=t0, t1=t1, jump_ts=jump_ts, running_cost=running_cost, until=until,
        adjoint=adjoint, throw=throw, **asked,
    )  # fmt: skip
    check_kinds(scene, state)
    scene = told_of_constants(scene)
    t0, t1, ts, state = _as_arrays(t0, t1, ts, state)
    check_method(adjoint, throw)
    adjoint = adjoint or Replay()
    if capture_speed is None:
        asked["capture_speed"] = default_capture_speed(state.q.dtype)
    settings, capture_speed = run_settings(asked, adjoint, ts, state, (scene, state, t0, t1, ts))
    check_mesh(scene, running_cost, state, t0, t1, ts)
    if throw is True:
        raise_unless_times_fit(t0, t1, ts)
    jump_ts = declared_jump_times(scene, jump_ts, state.q.dtype)
    mode = mode_as_arrays(mode)
    if scene.located_discontinuities:
        scene, running_cost, mode = located(scene, running_cost, t0, state, mode)
    scene, running_cost, switching, program = _prepared(scene, running_cost, t0, state, mode)
    until, ending = checked_until(until, own_scene(scene), lambda: blank_event(scene, t0, state, own_mode(mode)))
    fixed = lambda x: Fixed.unless_constant(x, state.q.dtype)
    depth = fixed(settings.rtol), fixed(settings.atol)
    mechanics = MechanicalSystem(
        scene, running_cost, fixed(capture_speed), state.q.shape[0], depth, jump_ts, until, program=program + ending
    )
    system = mechanics if switching is None else SwitchedSystem(mechanics, *switching, mode)
    (system, state, t0), (t1, ts), mark = entering((system, state, t0), (t1, ts), state.q.dtype, adjoint, throw)
    with waiting("compiling and simulating", progress):
        found = _simulate(system, state, (t0, t1, ts), mark, settings, adjoint)
    shown = lambda motion: shown_by_values(*seen((written, state, (t0, t1, ts))), motion.come_from(written, again))
    trajectory = leaving(found, (system, state, t0, t1, ts), adjoint, throw, shown)
    known = not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trajectory))
    return trajectory.come_from(written, again) if known else trajectory


def _prepared(scene: AbstractScene, running_cost, t0, state: State, mode):
    """The scene and the running cost, checked, in the type of the state, with all that they close over as leaves; and
    the rules of its switches and their number, None for a scene without; and what names the program of all these. A
    scene with switches becomes the scene that it is in its mode."""
    check_mode(scene, mode)
    scene, running_cost = in_type((scene, running_cost), state.q.dtype)
    in_its_mode, cost_there = in_mode(scene, running_cost, mode)
    switching, modes, of_switches = None, (), ""
    if isinstance(scene, AbstractSwitchedScene):
        count = check_switches(scene, state, mode)
        rules, of_switches = switch_rules(scene, t0, state, mode)
        switching, modes = (rules, count), (mode,)
    of_one_type = check_shapes(in_its_mode, state, cost_there)
    lifted, running_cost, program = lift_closures(in_its_mode, running_cost, t0, state, *modes)
    scene, running_cost = in_mode(lifted, running_cost, mode)
    scene = scene if of_one_type else TypedScene(scene, state.q.dtype)
    return scene, running_cost, switching, program + of_switches


@eqx.filter_jit
def _simulate(
    system: MechanicalSystem | SwitchedSystem, state: State, horizon, mark, settings: RunSettings, adjoint
) -> tuple[Trajectory, Any]:
    """The trajectory and the mark beside it."""
    t0, t1, ts = horizon
    mechanics = _mechanics(system)
    if settings.max_step is None:
        system.warn_of_sampled(t0, jnp.concatenate([state.q, state.v]))
    declared = mechanics.jump_ts is not None
    warn_of_discontinuities(mechanics.scene, t0, state.q, state.v, mechanics.running_cost, declared)
    if isinstance(system, SwitchedSystem):
        warn_of_switch(system.rules, mechanics.scene, t0, state.q, state.v, system.first_mode)
    scene = with_known_mass(condensed(mechanics.scene, t0, state.q, state.v), state.q)
    mechanics = dataclasses.replace(mechanics, scene=scene)
    cost = Shapes.of(jax.eval_shape(lambda: mechanics.cost_rate(t0, state.q, state.v)))
    x0 = jnp.concatenate([state.q, state.v, jnp.zeros(cost.size, state.q.dtype)])
    mode = mode_before_any(mechanics.scene, t0, state.q)
    system, mode = system.begin(mechanics, mode, x0) if isinstance(system, SwitchedSystem) else (mechanics, mode)
    status = horizon_status(t0, t1, ts, settings, number(mechanics.capture_speed))
    options = Options(mode, status, settings, mechanics.scene.known_discontinuities)
    reported = differentiable_motion(Problem(system, x0, t0, t1, ts, mark), options, adjoint)
    return _trajectory(system, t1, ts, reported, cost), reported.observed.out_of_steps


def _trajectory(system: MechanicalSystem | SwitchedSystem, t1, ts, reported: Reported, cost: Shapes) -> Trajectory:
    final, samples, states, _ = reported.observed
    mechanics, (closed, mode) = _mechanics(system), _modes(reported.mode)
    status = may_end(mechanics.scene, mechanics.split(final)[0], reported.status)
    end, end_time = end_of(reported, status, t1, mechanics.until is not None)
    q, v, z = mechanics.split(end)
    events = system.events(states, reported.marks)
    sampled = (None, None) if samples is None else mechanics.split(samples)[:2]
    doubt_time = where_in_doubt(status, reported.doubt_time)
    return Trajectory(
        ts, *sampled, State(q, v), cost.restore(z), events, closed, status, end_time, doubt_time,
        Steps(reported.accepted, reported.rejected), mode,
    )  # fmt: skip


def _mechanics(system: MechanicalSystem | SwitchedSystem) -> MechanicalSystem:
    return system.mechanics if isinstance(system, SwitchedSystem) else system


def _modes(mode: ContactMode | SwitchedMode):
    """Contacts held closed, and the scene's own mode."""
    return (mode.contacts.active, own_mode(mode.own)) if isinstance(mode, SwitchedMode) else (mode.active, None)


def _as_arrays(t0, t1, ts, state):
    dtype = jnp.result_type(state.q, state.v)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise TypeError(f"The state must be real, but has type {dtype}.")
    t0, t1 = (real_array(name, t, 0).astype(dtype) for name, t in (("t0", t0), ("t1", t1)))
    ts = None if ts is None else real_array("ts", ts, 1).astype(dtype)
    return t0, t1, ts, State(state.q.astype(dtype), state.v.astype(dtype))
