"""Settings of a run, and the solver that it is stepped with, made from the Diffrax solver that the caller chose."""

from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax.extend.core import ClosedJaxpr, Jaxpr

from .explicit import ExplicitRungeKutta

TERM = diffrax.ODETerm(lambda t, x, args: args[0].flow(t, x, args[1]))
"""The vector field; `args` is (system, mode)."""


class ProjectedSolver(diffrax.AbstractSolver):
    """A Diffrax solver whose state is projected back on its mode's constraints after each step."""

    solver: diffrax.AbstractSolver

    @property
    def term_structure(self):
        return self.solver.term_structure

    @property
    def interpolation_cls(self):
        return self.solver.interpolation_cls

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def func(self, terms, t0, y0, args):
        return self.solver.func(terms, t0, y0, args)

    def init(self, terms, t0, t1, y0, args):
        return self.solver.init(terms, t0, t1, y0, args)

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        del made_jump  # the projection moved the state, so what the solver remembers of its last stage is stale
        y1, error, dense_info, state, result = self.solver.step(terms, t0, t1, y0, args, solver_state, True)
        system, mode = args
        y1, moved = system.project_with_error(t1, y1, mode)
        return y1, error + moved, dense_info, state, result


UNROLLED_OPERATIONS = 60
"""Flows of up to this many operations have their stages written out; larger ones gain nothing by it."""
UNROLLED_WHERE_DIFFERENTIATED = 40
"""The same where a step is differentiated. With larger flows that gains a tenth of the time at most, and compilation
takes up to twice as long."""


class FlowSize(NamedTuple):
    """How many primitive operations one evaluation of the flow takes, those of inner functions counted in."""

    whole: int
    unconstrained: int | None
    """In modes that constrain nothing; None where the flow is the same in every mode."""


def prepare_solver(solver: diffrax.AbstractSolver, rtol, atol, loop: str, size: FlowSize) -> diffrax.AbstractSolver:
    """The caller's solver, ready for one step at a time of a flow of that size.

    Explicit tableaus are run by stages of our own. An implicit solver's root finder gets the tolerances of the step
    size control (as `diffeqsolve` would give it). `loop` is how a solver of Diffrax runs its own stages: "lax" going
    forward, "bounded" where the step is differentiated.
    """
    wrapped = isinstance(solver, diffrax.AbstractWrappedSolver)  # it claims to be of the type that it wraps
    if isinstance(solver, diffrax.AbstractERK) and not wrapped:
        return _explicit(solver, size, differentiated=loop == "bounded")
    return ProjectedSolver(_of_diffrax(solver, rtol, atol, loop))


def _of_diffrax(solver: diffrax.AbstractSolver, rtol, atol, loop: str) -> diffrax.AbstractSolver:
    """A solver of Diffrax, or the one inside of it, with the tolerances and the kind of loop that it needs."""
    if isinstance(solver, diffrax.AbstractWrappedSolver):
        return eqx.tree_at(lambda s: s.solver, solver, _of_diffrax(solver.solver, rtol, atol, loop))
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        solver = _with_tolerances(solver, rtol, atol)
    if isinstance(solver, diffrax.AbstractRungeKutta):
        return eqx.tree_at(lambda s: s.scan_kind, solver, loop, is_leaf=lambda leaf: leaf is None)
    return solver


def _explicit(solver: diffrax.AbstractERK, size: FlowSize, differentiated: bool) -> ExplicitRungeKutta:
    """Stages of our own, for either flow.

    A second, shorter flow is a second copy to compile, which pays where it is written out. Elsewhere than on a CPU the
    elements of a batch go through every branch: one more would only be a burden."""
    written_out = UNROLLED_WHERE_DIFFERENTIATED if differentiated else UNROLLED_OPERATIONS
    unconstrained = None
    if size.unconstrained is not None and size.unconstrained <= written_out and jax.default_backend() == "cpu":
        unconstrained = ExplicitRungeKutta(solver, unrolled=True)
    return ExplicitRungeKutta(solver, size.whole <= written_out, unconstrained)


def flow_size(system, mode, t, x) -> FlowSize:
    """How long the flow of a system is, looked at once before anything is compiled."""
    dynamic, static = eqx.partition((system, mode), eqx.is_array)

    def flow(dynamic, t, x, pick):
        system, mode = eqx.combine(dynamic, static)
        return pick(system, mode).flow(t, x, mode)

    operations = lambda pick: _count(jax.make_jaxpr(flow, static_argnums=3)(dynamic, t, x, pick).jaxpr)
    whole = operations(lambda system, mode: system)
    if system.unconstrained(mode) is None:
        return FlowSize(whole, None)
    return FlowSize(whole, operations(lambda system, mode: system.unconstrained(mode)[1]))


def _count(jaxpr) -> int:
    parameters = [list(equation.params.values()) for equation in jaxpr.eqns]
    is_jaxpr = lambda leaf: isinstance(leaf, Jaxpr | ClosedJaxpr)
    inner = filter(is_jaxpr, jax.tree.leaves(parameters, is_leaf=is_jaxpr))
    return len(jaxpr.eqns) + sum(_count(getattr(found, "jaxpr", found)) for found in inner)


def _with_tolerances(solver, rtol, atol):
    inherit = diffrax.Kvaerno5().root_finder.rtol  # Diffrax's sentinel for "as the step size controller"
    tolerances = dict(rtol=rtol, atol=atol, norm=optx.rms_norm)
    names = [name for name in tolerances if getattr(solver.root_finder, name) is inherit]
    return eqx.tree_at(
        lambda s: [getattr(s.root_finder, name) for name in names], solver, [tolerances[name] for name in names]
    )


def one_step(solver: diffrax.AbstractSolver, system, mode, t0, t1, x0):
    """The state after one step of the solver from (t0, x0) to t1: what a recorded step is replayed with."""
    if isinstance(solver, ExplicitRungeKutta):
        return solver.advance(system, mode, t0, t1, x0)
    args = (system, mode)
    state = solver.init(TERM, t0, t1, x0, args)
    return solver.step(TERM, t0, t1, x0, args, state, jnp.array(False))[0]


def step_with_error(solver: diffrax.AbstractSolver, system, mode, t0, t1, x0):
    """The state after one step before it is projected on its mode's constraints, and the estimate of its error."""
    if isinstance(solver, ExplicitRungeKutta):
        return solver.advance_with_error(system, mode, t0, t1, x0)
    inner = solver.solver if isinstance(solver, ProjectedSolver) else solver
    args = (system, mode)
    state = inner.init(TERM, t0, t1, x0, args)
    return inner.step(TERM, t0, t1, x0, args, state, jnp.array(False))[:2]


class Stepper(eqx.Module):
    """How steps are taken: the method and its error control."""

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractAdaptiveStepSizeController
    max_steps: int = eqx.field(static=True)
    """How many steps may be tried in all."""
    segment_steps: int = eqx.field(static=True)
    """How many steps a segment may have."""


class RunSettings(eqx.Module):
    """Settings of a run: what trades accuracy for time, and how much room there is."""

    solver: diffrax.AbstractSolver
    rtol: Any
    atol: Any
    max_events: int = eqx.field(static=True)
    max_steps: int = eqx.field(static=True)
    segment_steps: int | None = eqx.field(default=None, static=True)
    """Steps are not recorded, and no segment has more than this; None: all are recorded."""

    max_step: Any = None
    """Longest step; None for as long as the error control allows."""

    derivative_rtol: Any = None
    """Error allowed to a derivative in one step, relative; None for what the tolerances of the motion stand for, inf
    for no control."""

    def stepper(self, size: FlowSize) -> Stepper:
        """Solver and error control of the forward pass, for a flow of that size."""
        solver = prepare_solver(self.solver, self.rtol, self.atol, "lax", size)
        control = diffrax.PIDController(rtol=self.rtol, atol=self.atol, dtmax=self.max_step)
        return Stepper(solver, control, self.max_steps, self.segment_steps or self.max_steps)

    def replay_solver(self, size: FlowSize) -> diffrax.AbstractSolver:
        """The same solver where its steps are differentiated."""
        return prepare_solver(self.solver, self.rtol, self.atol, "bounded", size)
