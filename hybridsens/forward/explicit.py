"""Any explicit Runge-Kutta method of Diffrax with its stages written out.

Diffrax runs the stages of a step in a loop of its own; written out, XLA fuses them into straight arithmetic.
"""

from collections.abc import Callable
from typing import ClassVar

import diffrax
import jax.numpy as jnp


class UnrolledRungeKutta(diffrax.AbstractSolver):
    """x1 = x0 + h sum_i b_i k_i,  k_i = f(t0 + c_i h, x0 + h sum_j a_ij k_j), for an explicit tableau.

    `args` is (system, mode). A state that its mode constrains is projected back at the end of the step, before the
    last stage of a first-same-as-last tableau is evaluated there.
    """

    solver: diffrax.AbstractERK
    """The Diffrax solver whose tableau, order and error order are used."""

    term_structure: ClassVar = diffrax.AbstractTerm
    interpolation_cls: ClassVar[Callable] = diffrax.LocalLinearInterpolation

    def order(self, terms):
        return self.solver.order(terms)

    def error_order(self, terms):
        return self.solver.error_order(terms)

    def func(self, terms, t0, y0, args):
        return terms.vf(t0, y0, args)

    def init(self, terms, t0, t1, y0, args):
        del t1
        return terms.vf(t0, y0, args) if self.solver.tableau.fsal else None

    def step(self, terms, t0, t1, y0, args, solver_state, made_jump):
        del made_jump  # every segment starts with `init`
        tableau = self.solver.tableau
        system, mode = args
        h = t1 - t0
        first = solver_state if tableau.fsal else terms.vf(t0, y0, args)
        stages = [first]
        last = len(tableau.a_lower) - 1
        for i, (a, c) in enumerate(zip(tableau.a_lower, tableau.c, strict=True)):
            y = y0 + h * _combine(a, stages)
            if tableau.fsal and i == last:
                y1 = y = system.project(t1, y, mode)
            stages.append(terms.vf(t0 + float(c) * h, y, args))
        if not tableau.fsal:
            y1 = system.project(t1, y0 + h * _combine(tableau.b_sol, stages), mode)
        error = h * _combine(tableau.b_error, stages)
        dense_info = dict(y0=y0, y1=y1)
        return y1, error, dense_info, (stages[-1] if tableau.fsal else None), diffrax.RESULTS.successful


def _combine(weights, stages):
    terms = [float(w) * k for w, k in zip(weights, stages, strict=True) if w != 0]
    return sum(terms[1:], terms[0]) if terms else jnp.zeros_like(stages[0])
