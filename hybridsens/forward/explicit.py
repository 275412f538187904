"""Any explicit Runge-Kutta method of Diffrax, with its stages arranged for XLA.

Diffrax runs the stages of a step in a loop of its own. Written out, a small flow's stages fuse into straight
arithmetic; a large flow is better traced once and run in a plain loop, since compile time grows with every copy of it.
"""

from collections.abc import Callable
from typing import ClassVar

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax


class ExplicitRungeKutta(diffrax.AbstractSolver):
    """x1 = x0 + h sum_i b_i k_i,  k_i = f(t0 + c_i h, x0 + h sum_j a_ij k_j), for an explicit tableau.

    `args` is (system, mode). A state that its mode constrains is projected back at the end of the step, before the
    last stage of a first-same-as-last tableau is evaluated there.
    """

    solver: diffrax.AbstractERK
    """The Diffrax solver whose tableau, order and error order are used."""
    unrolled: bool = eqx.field(static=True)
    """Whether the stages are written out or run in a loop."""
    unconstrained: "ExplicitRungeKutta | None" = None
    """What steps are taken with in modes that constrain nothing, by their shorter flow; None for all alike."""

    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar[Callable] = diffrax.LocalLinearInterpolation

    @property
    def tableau(self) -> diffrax.ButcherTableau:
        tableau = self.solver.tableau
        assert isinstance(tableau, diffrax.ButcherTableau)  # an explicit method has no second one
        return tableau

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def init(self, terms, t0, t1, y0, args):
        del t1
        return terms.vf(t0, y0, args) if self.tableau.fsal else None

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        del made_jump  # every segment starts with `init`
        system, mode = args
        take = lambda solver, pick: solver._step(terms, t0, t1, y0, (pick(system), mode), solver_state)
        y1, error, last = by_mode(self, system, mode, take)
        return y1, error, dict(y0=y0, y1=y1), last, diffrax.RESULTS.successful

    def _step(self, terms, t0, t1, y0, args, solver_state):
        """The new state, its error, and the last stage."""
        tableau = self.tableau
        system, mode = args
        h = t1 - t0
        first = solver_state if tableau.fsal else terms.vf(t0, y0, args)
        rows = tableau.a_lower[:-1] if tableau.fsal else tableau.a_lower
        run = _stages_written_out if self.unrolled else _stages_in_a_loop
        stages = run(lambda c, y: terms.vf(t0 + c * h, y, args), y0, h, first, rows, tableau.c)
        y1 = system.project(t1, y0 + h * _combine(_weights(tableau), stages), mode)
        last = terms.vf(t1, y1, args) if tableau.fsal else None
        return y1, h * _combine(tableau.b_error, [*stages, last] if tableau.fsal else stages), last

    def advance(self, system, mode, t0, t1, y0):
        """The state after one step and nothing else: what a recorded step is replayed with, inside of `by_mode`."""
        tableau = self.tableau
        h = t1 - t0
        rows = tableau.a_lower[:-1] if tableau.fsal else tableau.a_lower
        run = _stages_written_out if self.unrolled else _stages_in_a_loop
        stages = run(lambda c, y: system.flow(t0 + c * h, y, mode), y0, h, None, rows, tableau.c)
        return system.project(t1, y0 + h * _combine(_weights(tableau), stages), mode)


def by_mode(solver: diffrax.AbstractSolver, system, mode, run: Callable):
    """`run(solver, pick)`, where `pick` makes of a system the one to step: in a mode that constrains nothing, the same
    system by its shorter flow, with a solver made for it. A branch around a whole step, not inside of its stages."""
    whole = lambda: run(solver, lambda system: system)
    shorter = system.unconstrained(mode)
    if shorter is None or not isinstance(solver, ExplicitRungeKutta) or solver.unconstrained is None:
        return whole()
    made_for_it = solver.unconstrained
    return lax.cond(shorter[0], lambda: run(made_for_it, lambda system: system.unconstrained(mode)[1]), whole)


def _weights(tableau):
    """Weights of the stages that the new state is made from; a first-same-as-last tableau's last stage is not among
    them."""
    return tableau.b_sol[:-1] if tableau.fsal else tableau.b_sol


def _stages_written_out(f, y0, h, first, rows, c):
    stages = [f(0.0, y0) if first is None else first]
    for row, c_i in zip(rows, c, strict=False):
        stages.append(f(float(c_i), y0 + h * _combine(row, stages)))
    return stages


def _stages_in_a_loop(f, y0, h, first, rows, c):
    count = len(rows) + 1
    a = np.zeros((count, count))
    for i, row in enumerate(rows):
        a[i + 1, : len(row)] = row
    a, c = jnp.asarray(a, y0.dtype), jnp.asarray(np.concatenate([[0.0], c[: count - 1]]), h.dtype)

    def stage(k, i):
        return k.at[i].set(f(c[i], y0 + h * (a[i] @ k))), None

    k = jnp.zeros((count, *y0.shape), y0.dtype)
    if first is not None:
        k = k.at[0].set(first)
    k, _ = lax.scan(stage, k, jnp.arange(0 if first is None else 1, count))
    return [k[i] for i in range(count)]


def _combine(weights, stages):
    terms = [float(w) * k for w, k in zip(weights, stages, strict=True) if w != 0]
    return sum(terms[1:], terms[0]) if terms else jnp.zeros_like(stages[0])
