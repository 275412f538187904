"""Any explicit Runge-Kutta method of Diffrax, with its stages arranged for XLA.

Diffrax runs the stages of a step in a loop of its own. Written out, a small flow's stages fuse into straight
arithmetic; a large flow is better traced once and run in a plain loop, since compile time grows with every copy of it.
"""

from collections.abc import Callable
from typing import Any, ClassVar

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
        take = lambda solver, pick: solver._step(pick(system), mode, t0, t1, y0, solver_state)
        y1, error, last = by_mode(self, system, mode, take)
        return y1, error, dict(y0=y0, y1=y1), last, diffrax.RESULTS.successful

    def _step(self, system, mode, t0, t1, y0, first):
        """The new state, its error, and the last stage; `first` is the first stage, None where it is not known.

        Stages k_i are handed on as the first one, k_0, and the `rises` k_i - k_0 of the others (see `_mean`)."""
        moved_to, first, rises = self._moved(system, mode, t0, t1, y0, first)
        y1, moved = system.project_with_error(t1, moved_to, mode)
        last = system.flow(t1, y1, mode) if self.tableau.fsal else None
        return y1, self._error(t1 - t0, first, rises, last) + moved, last

    def _moved(self, system, mode, t0, t1, y0, first=None):
        """The state after one step before it is projected, k_0, and the rises of the other stages."""
        h = t1 - t0
        first, rises = self._stages(lambda c, y: system.flow(t0 + c * h, y, mode), y0, h, first)
        return y0 + h * _mean(_weights(self.tableau), 1.0, first, rises), first, rises

    def _error(self, h, first, rises, last):
        """h sum_i (b_i - b^_i) k_i of the embedded pair."""
        return h * _mean(self.tableau.b_error, 0.0, first, rises if last is None else [*rises, last - first])

    def advance(self, system, mode, t0, t1, y0):
        """The state after one step by the whole flow, and nothing else: what a recorded step is replayed with."""
        return system.project(t1, self._moved(system, mode, t0, t1, y0)[0], mode)

    def advance_with_error(self, system, mode, t0, t1, y0):
        """The state after one step before it is projected, and its error: what a step is differentiated by, inside of
        `by_mode`."""
        y1, first, rises = self._moved(system, mode, t0, t1, y0)
        last = system.flow(t1, y1, mode) if self.tableau.fsal else None
        return y1, self._error(t1 - t0, first, rises, last)

    def points(self, f, y0, h):
        """The states X_i (stage, state) at which a step evaluates the flow f(c, X), and the state after it: what the
        adjoint of a step is made from whose stages run in a loop."""
        (first, rises), points = _stages_in_a_loop(f, y0, h, None, *self._rows_and_times())
        y1 = y0 + h * _mean(_weights(self.tableau), 1.0, first, rises)
        return (jnp.concatenate([points, y1[None]]) if self.tableau.fsal else points), y1

    def _stages(self, f, y0, h, first) -> tuple[Any, list[Any]]:
        """k_0, and k_i - k_0 of the other stages but a first-same-as-last one."""
        if self.unrolled:
            return _stages_written_out(f, y0, h, first, *self._rows_and_times())
        return _stages_in_a_loop(f, y0, h, first, *self._rows_and_times())[0]

    def _rows_and_times(self):
        """a_ij and c_i of the stages but a first-same-as-last one."""
        tableau = self.tableau
        rows = tableau.a_lower[:-1] if tableau.fsal else tableau.a_lower
        return rows, tableau.c[: len(rows)]


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
    first = f(0.0, y0) if first is None else first
    rises = []
    for row, c_i in zip(rows, c, strict=True):
        rises.append(f(float(c_i), y0 + h * _mean(row, float(c_i), first, rises)) - first)
    return first, rises


def _stages_in_a_loop(f, y0, h, first, rows, c):
    """The stages, and the states (stage, state) at which they are evaluated. `ahead` holds what the coming stages start
    from so far, the next one first: y_i = y0 + h ahead_i."""
    count, known = len(rows) + 1, 0 if first is None else 1
    c = np.concatenate([[0.0], c])
    adds = np.zeros((count, count))  # adds[j, i - j - 1]: what stage j adds to stage i
    adds[0, :-1] = c[1:]  # the first stage counts in full, with the sum of the row; the others by their rises
    for i, row in enumerate(rows, 1):
        for j in range(1, i):
            adds[j, i - j - 1] = row[j]
    adds, c = jnp.asarray(adds, y0.dtype), jnp.asarray(c, h.dtype)

    def stage(carry, at):
        first, ahead = carry
        i, c_i, add = at
        point = y0 + h * ahead[0]
        k = f(c_i, point)
        rise = k - first
        first = jnp.where(i == 0, k, first)
        ahead = jnp.concatenate([ahead[1:], jnp.zeros_like(ahead[:1])]) + add[:, None] * rise
        return (first, ahead), (rise, point)

    # An unknown first stage is 0 until its turn comes, so that its rise is all of it; no rise of it is returned.
    start = jnp.zeros_like(y0) if first is None else first
    ahead = adds[0][:, None] * start
    stages = jnp.arange(known, count), c[known:], adds[known:]
    (first, _), (rises, points) = lax.scan(stage, (start, ahead), stages)
    return (first, [rises[i] for i in range(1 - known, count - known)]), points


def _mean(weights, total: float, first, rises):
    """sum_i w_i k_i, of weights that add up to `total`, as total k_0 + sum_i w_i (k_i - k_0).

    So a constant flow is summed exactly. Large weights that cancel leave a rounding that falls to the same side in
    every step: the energy of a falling body would drift with the number of steps."""
    terms = [float(w) * rise for w, rise in zip(weights[1:], rises, strict=True) if w != 0]
    return sum(terms, total * first if total else jnp.zeros_like(first))
