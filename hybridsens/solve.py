"""Motion of any hybrid system, with its exact gradient."""

import dataclasses
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
from .discontinuities import warn_of_system
from .export.names import event_names
from .flattened import FlattenedSystem
from .forward.solver import RunSettings
from .located.system import located, own_guards, own_mode
from .numerics.fixed import Fixed
from .numerics.shapes import Shapes
from .outcome import Steps, raise_unless_times_fit, seen
from .passes import Options, Problem
from .reported import end_of, where_in_doubt
from .settings import check_method, declared_jump_times, horizon_status, run_settings
from .solution import Solution, blank_event, last_events
from .status import Status
from .system import AbstractHybridSystem
from .system_checks import check_system, lifted, mode_as_arrays, state_as_arrays, warn_of_transition
from .until import checked_until
from .validation.arguments import check_mesh, in_type, real_array
from .validation.asked import kind_of
from .validation.not_finite import not_finite_among
from .validation.numbers import told_of_constants
from .validation.own_start import check_mode_given
from .validation.same_function import same_function
from .waiting import waiting


def solve(
    system: AbstractHybridSystem,
    x0: Any,
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
    adjoint: AbstractGradientMethod | None = None,
    throw: bool | Literal["nan"] = True,
    progress: bool = False,
) -> Solution:
    """Motion of a hybrid system from t0 to t1 through its events, with its exact gradient.

        x' = flow(t, x, mode)   until a guard falls through 0;   then  (x, mode) = transition(event, t, x, mode)

    Write the cost J in plain JAX on what is returned; `eqx.filter_grad(J)(system)` is then dJ/d(system), with the
    jump conditions (T8)-(T10) of the adjoint applied at every event. Gradients reach the leaves of the system, x0, t0,
    t1, ts and the jump times, under `jax.jit` and `jax.vmap` in any order. The mode is never differentiated.

    Arguments:

    - `system`: what moves; see `AbstractHybridSystem`.
    - `x0`: initial state, any PyTree of real arrays or numbers.
    - `mode`: initial mode, any PyTree of arrays or numbers; None where there is only one.
    - `t0`, `t1`: horizon, t1 > t0.
    - `ts`: sorted times in [t0, t1] at which states are wanted; at an event's time, the state after it.
    - `jump_ts`: times at which the flow has a kink or a jump; steps end there. Default: `system.jump_times()`.
    - `running_cost`: `running_cost(system, t, x, mode)`, a scalar or a PyTree; its integral comes back as `.cost`.
    - `until`: `until(system, event)`, a boolean: the motion ends with the first event for which it is True, or at t1.
      `event` is one row of `.events`, whose `count` is how many events there have been with it. `.final`, `.cost` and
      `.end_time` are then those of that event and move with it in derivatives; samples at later times are nan.
    - `solver`: any Diffrax solver of one term with an error estimate (KenCarp's have two); default `diffrax.Tsit5()`.
    - `rtol`, `atol`: tolerances of the error control per step. Other values do not compile anew.
    - `max_events`, `max_steps`: room for events, and for steps tried; the record takes memory for both.
    - `max_step`: longest step. Dips of a guard inside a step are searched for by bounds, however short; only a guard
      made by an operation without known bounds (a table, a loop, a special function) is sampled instead, at 16 places
      of a step or more, and a warning says so: for such a one give the time that its shortest dip lasts.
    - `adjoint`: `Replay()` (default) or another gradient method, as for `simulate`.
    - `throw`: raise unless the motion is successful; with False, look at `.status`; "nan" makes value and gradient of a
      motion that does not reach t1 nan.
    - `progress`: show for how long it compiles and runs.

    Raises: ValueError or TypeError for what does not fit (structures, shapes, types), and for a derivative in a mode
    that `adjoint` does not serve; `SimulationError` for what only the values show, and for a derivative that runs
    out of steps, as `simulate` does.
    """
    if not isinstance(system, AbstractHybridSystem):
        elsewhere = ", a scene: use hybridsens.simulate" if hasattr(system, "mass_matrix") else ""
        raise TypeError(f"`system` must be a hybridsens.AbstractHybridSystem, but is {kind_of(system)}{elsewhere}.")
    system, running_cost = told_of_constants(system), same_function(running_cost)
    check_method(adjoint, throw)
    x0, dtype = state_as_arrays(x0)
    check_mode_given(system, mode, "system")
    mode = mode_as_arrays(mode)
    t0, t1 = (real_array(name, t, 0).astype(dtype) for name, t in (("t0", t0), ("t1", t1)))
    ts = None if ts is None else real_array("ts", ts, 1).astype(dtype)
    jump_ts = declared_jump_times(system, jump_ts, dtype)
    check_mesh(system, running_cost, x0, t0, t1, ts)
    if throw is True:
        raise_unless_times_fit(t0, t1, ts)
    written = system, x0  # what a message speaks of
    system, running_cost = in_type((system, running_cost), dtype)
    counts, cost = check_system(system, running_cost, t0, x0, mode)
    until, ending = checked_until(until, system, lambda: blank_event(t0, x0, mode))
    system, running_cost, program = lifted(system, running_cost, t0, x0, mode)
    system, running_cost = in_type((system, running_cost), dtype)
    adjoint = adjoint or Replay()
    asked = dict(
        solver=solver, rtol=rtol, atol=atol, max_events=max_events, max_steps=max_steps, max_step=max_step
    )
    again = dict(
        system=system, x0=x0, mode=mode, t0=t0, t1=t1, jump_ts=jump_ts, running_cost=running_cost, until=until,
        adjoint=adjoint, throw=throw, **asked,
    )  # fmt: skip
    settings, _ = run_settings(asked, adjoint, ts, x0, (system, x0, t0, t1, ts))
    given, later = (system, running_cost, x0, t0, jump_ts), (t1, ts)
    (system, running_cost, x0, t0, jump_ts), (t1, ts), mark = entering(given, later, dtype, adjoint, throw)
    guards, first_mode = counts.guards, mode
    if written[0].located_discontinuities:
        system, running_cost, guards, first_mode = located(system, running_cost, guards, (t0, x0, mode))
    names = event_names(written[0], counts.guards, counts.scheduled or 0, guards - counts.guards)
    depth = Fixed.unless_constant(settings.rtol, dtype), Fixed.unless_constant(settings.atol, dtype)
    flat = FlattenedSystem(
        system, running_cost, jump_ts, Shapes.of(x0), guards, counts.scheduled, first_mode, until, depth,
        program + ending,
    )  # fmt: skip
    with waiting("compiling and simulating", progress):
        solution, mark = _solve(flat, x0, first_mode, (t0, t1, ts), mark, settings, adjoint, Shapes.of(cost))
    solution = eqx.tree_at(lambda s: s.events, solution, dataclasses.replace(solution.events, names=names))
    shown = lambda solution: _shown_by_values(*seen((*written, (t0, t1, ts))), solution)
    solution = leaving((solution, mark), (flat, x0, t0, t1, ts), adjoint, throw, shown)
    return eqx.tree_at(lambda s: s.again, solution, Call.of(again), is_leaf=lambda leaf: leaf is None)


class Call(eqx.Module):
    """A call of `solve` with all arguments but `ts`, as a PyTree: it rides along with the solution through JAX."""

    arrays: tuple
    rest: tuple = eqx.field(static=True)
    tree: Any = eqx.field(static=True)

    @classmethod
    def of(cls, given: dict) -> "Call":
        leaves, tree = jax.tree.flatten(given, is_leaf=lambda leaf: leaf is None)
        arrays = tuple(leaf if eqx.is_array(leaf) else None for leaf in leaves)
        return cls(arrays, tuple(None if eqx.is_array(leaf) else leaf for leaf in leaves), tree)

    def __call__(self, ts) -> Solution:
        return solve(**self._given(), ts=ts)

    def __reduce__(self):
        """Pickled as what was given: a PyTree structure that was pickled cannot make Equinox's modules again."""
        return Call.of, (self._given(),)

    def horizon(self) -> tuple[Array, Array]:
        """(t0, t1)."""
        given = self._given()
        return given["t0"], given["t1"]

    def initial_mode(self) -> Any:
        """The mode in which the motion begins."""
        return self._given()["mode"]

    def initial_guards(self) -> Any:
        """The guards where the motion begins."""
        given = self._given()
        return given["system"].guards(given["t0"], given["x0"], given["mode"])

    def _given(self) -> dict[str, Any]:
        leaves = [fixed if array is None else array for array, fixed in zip(self.arrays, self.rest, strict=True)]
        return self.tree.unflatten(leaves)


def _shown_by_values(system: AbstractHybridSystem, x0, horizon: tuple, solution: Solution) -> str:
    """An end to the message of a motion that did not reach its end; "" where nothing can be seen."""
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves((solution.status.code, horizon))):
        return ""
    given = not_finite_among(system, x0) if solution.status == Status.non_finite else ""
    return f" {given}" if given else last_events(solution)


@eqx.filter_jit
def _solve(flat: FlattenedSystem, x0, mode, horizon, mark, settings: RunSettings, adjoint, cost: Shapes):
    """The solution and the mark beside it."""
    t0, t1, ts = horizon
    cost_rate = None if flat.running_cost is None else flat.cost_rate
    warn_of_system(flat.system, cost_rate, (t0, x0, mode), flat.jump_ts is not None)
    warn_of_transition(flat.system, t0, x0, mode)
    start = jnp.concatenate([flat.shapes.flatten(x0, t0.dtype), jnp.zeros(cost.size, t0.dtype)])
    if settings.max_step is None:
        flat.warn_of_sampled(t0, start)
    known = flat.system.known_discontinuities
    options = Options(flat.watched_mode(mode, start), horizon_status(t0, t1, ts, settings), settings, known)
    reported = differentiable_motion(Problem(flat, start, t0, t1, ts, mark), options, adjoint)
    final, samples, states, mark = reported.observed
    samples = None if samples is None else flat.split(samples)[0]
    steps = Steps(reported.accepted, reported.rejected)
    status = flat.status_at_end(t1, final, reported.mode, reported.status)
    end, end_time = end_of(reported, status, t1, flat.until is not None)
    x, z = flat.split(end)
    total = None if flat.running_cost is None else cost.restore(z)
    doubt_time = where_in_doubt(status, reported.doubt_time)
    waiting, mode = own_guards(~reported.mode.watch.armed, flat.system), own_mode(reported.mode.given)
    solution = Solution(
        ts, samples, x, total, flat.events(states, reported.marks), mode, status, end_time, doubt_time, steps, waiting,
        None,
    )  # fmt: skip
    return solution, mark
