"""The adjoint of an explicit Runge-Kutta step, stage by stage.

Where a step runs its stages in a loop, so does its adjoint, by hand: the loop holds one copy of the flow and of its
transpose to compile, and keeps of each stage the state at which it evaluates the flow. Differentiated by JAX, the loop
would keep every number that the transpose needs.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..forward.explicit import ExplicitRungeKutta
from .step import RecordedStep


def differentiated_in_a_loop(step: RecordedStep, solver: ExplicitRungeKutta, system):
    """The state at the end of a step before it is projected, and what carries back cotangents psi of it and epsilon of
    the step's error, both given row by row; of no error where epsilon is None.

        x1 = x0 + h sum_i b_i k_i      E = h sum_i e_i k_i      k_i = f(theta, X_i)      X_i = x0 + h sum_j a_ij k_j

        k_i* = h (b_i psi + e_i epsilon + sum_j a_ji X_j*)      X_i* = f_x^T k_i*
        x0*  = psi + sum_i X_i*                                 theta* = sum_i f_theta^T k_i*
    """
    h, mode, parameters = step.t1 - step.t0, step.mode, step.parameters
    flow = lambda p, c, x: system(p).flow(step.t0 + c * h, x, mode)
    points, x1 = solver.points(lambda c, x: flow(parameters, c, x), step.x0, h)
    a, b, e, c = _arrays(solver.tableau, step.x0.dtype)

    def of_step(psi, epsilon):
        # A last stage that only the error is made from is left out where that is not wanted.
        count = a.shape[0] if epsilon is not None else np.flatnonzero(b)[-1] + 1
        of_stages = h * b[:, None] * psi[:, None]
        if epsilon is not None:
            of_stages = of_stages + h * e[:, None] * epsilon[:, None]

        def stage(carry, at):
            of_stages, of_x0, total = carry
            i, c_i, point, a_i = at
            _, of_flow = jax.vjp(lambda p, x: flow(p, c_i, x), parameters, point)
            # One copy to compile; in turn, not side by side, products with vectors stay such.
            by_parameters, of_point = lax.map(of_flow, of_stages[:, i])
            of_stages = of_stages + h * a_i[:, None] * of_point[:, None]
            return (of_stages, of_x0 + of_point, jax.tree.map(jnp.add, total, by_parameters)), None

        nothing = jax.tree.map(lambda p: jnp.zeros((len(psi), *p.shape), p.dtype), parameters)
        stages = jnp.arange(count), *(jnp.asarray(rows[:count]) for rows in (c, points, a))
        (_, of_x0, total), _ = lax.scan(stage, (of_stages, psi, nothing), stages, reverse=True)
        return total, of_x0

    return x1, of_step


def _arrays(tableau: diffrax.ButcherTableau, dtype):
    """a, b, e and c of a tableau, as whole arrays."""
    count = len(tableau.b_sol)
    a = np.zeros((count, count))
    for i, row in enumerate(tableau.a_lower, 1):
        a[i, : len(row)] = row
    c = np.concatenate([[0.0], tableau.c])
    return tuple(np.asarray(entries, dtype) for entries in (a, tableau.b_sol, tableau.b_error, c))
