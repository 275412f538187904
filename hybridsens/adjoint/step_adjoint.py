"""The adjoint of one recorded step: exact replay, the continuous costate (T7), or an adjoint of Diffrax.

Where an explicit Runge-Kutta step runs its stages in a loop, so does its adjoint, by hand: the loop holds one copy of
the flow and of its transpose to compile, and keeps of each stage the state at which it evaluates the flow.
Differentiated by JAX, the loop would keep every number that the transpose needs.
"""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..forward.explicit import ExplicitRungeKutta, by_mode
from ..forward.solver import TERM, step_with_error
from ..validation.caller import warn_caller
from .step import RecordedStep, StepBack

MOST_STEPS = 4096
"""How many steps psi may take over one recorded step; one that needs more makes the gradient nan."""

MOST_DRIFT = 1e3
"""By how many times its tolerance a state that is integrated backward over a step may miss the recorded one."""

_DRIFT = (
    f'ContinuousCostate(state="backward") misses recorded states by more than {MOST_DRIFT:.0e} times its tolerance: '
    "the motion is too dissipative to be integrated backward, and the gradient is wrong. "
    'Use ContinuousCostate(state="recorded") or Replay().'
)


def exact_adjoint(step: RecordedStep, psi) -> StepBack:
    """Phi_x^T psi and Phi_theta^T psi of a step Phi, and the same of its error estimate E where that is wanted."""
    mode, t1 = step.mode, step.t1

    def carry_back(solver, pick):
        system = lambda p: pick(step.system(p))
        x1, pull_step = _differentiated(step, solver, system)
        _, pull_projection = jax.vjp(lambda p, x: system(p).project(t1, x, mode), step.parameters, x1)
        by_projection, psi_1 = pull_projection(psi)  # only what stays on the constraints matters, of the error too
        # Two rows of cotangents, of the state and of its error: (psi_1, 0) give the adjoint, (0, psi_1) its error.
        zero = jnp.zeros_like(psi)
        rows = (jnp.stack([psi_1, zero]), jnp.stack([zero, psi_1])) if step.controlled else (psi_1[None], None)
        total, psi_0 = pull_step(*rows)
        errors = jax.tree.map(lambda rows: rows[1], (total, psi_0)) if step.controlled else (None, None)
        total = jax.tree.map(lambda rows, added: rows[0] + added, total, by_projection)
        return StepBack(total, psi_0[0], *errors)

    return by_mode(step.solver, step.system(step.parameters), mode, carry_back)


def _differentiated(step: RecordedStep, solver, system):
    """The state at the end of a step before it is projected, and what carries back cotangents (row, state) of it and of
    the step's error."""
    if isinstance(solver, ExplicitRungeKutta) and not solver.unrolled:
        return differentiated_in_a_loop(step, solver, system)
    estimated = lambda p, x: step_with_error(solver, system(p), step.mode, step.t0, step.t1, x)
    if not step.controlled:
        x1, pull_state = jax.vjp(lambda p, x: estimated(p, x)[0], step.parameters, step.x0)
        return x1, lambda of_x1, _: lax.map(pull_state, of_x1)
    (x1, _), pull_step = jax.vjp(estimated, step.parameters, step.x0)
    # One copy to compile; in turn, not side by side, products with vectors stay such: up to a third quicker.
    return x1, lambda of_x1, of_error: lax.map(pull_step, (of_x1, of_error))


def differentiated_in_a_loop(step: RecordedStep, solver: ExplicitRungeKutta, system):
    """The state at the end of a step before it is projected, and what carries back cotangents (row, state): psi of it
    and epsilon of the step's error, or none of the error where epsilon is None.

        x1 = x0 + h sum_i b_i k_i      E = h sum_i e_i k_i      k_i = f(theta, X_i)      X_i = x0 + h sum_j a_ij k_j

        k_i* = h (b_i psi + e_i epsilon + sum_j a_ji X_j*)      X_i* = f_x^T k_i*
        x0*  = psi + sum_i X_i*                                 theta* = sum_i f_theta^T k_i*
    """
    h, mode, parameters = step.t1 - step.t0, step.mode, step.parameters
    flow = lambda p, c, x: system(p).flow(step.t0 + c * h, x, mode)
    points, x1 = solver.points(lambda c, x: flow(parameters, c, x), step.x0, h)
    a, b, e, c = _arrays(solver.tableau, step.x0.dtype)

    def pull_step(psi, epsilon):
        # A last stage that only the error is made from is left out where that is not wanted.
        count = a.shape[0] if epsilon is not None else np.flatnonzero(b)[-1] + 1
        by_stages = h * b[:, None] * psi[:, None]  # (row, stage, state)
        if epsilon is not None:
            by_stages = by_stages + h * e[:, None] * epsilon[:, None]

        def stage(carry, at):
            by_stages, by_x0, total = carry
            i, c_i, point, a_i = at
            _, pull_flow = jax.vjp(lambda p, x: flow(p, c_i, x), parameters, point)
            # One copy to compile; in turn, not side by side, products with vectors stay such.
            by_parameters, by_point = lax.map(pull_flow, by_stages[:, i])
            by_stages = by_stages + h * a_i[:, None] * by_point[:, None]
            return (by_stages, by_x0 + by_point, jax.tree.map(jnp.add, total, by_parameters)), None

        nothing = jax.tree.map(lambda p: jnp.zeros((len(psi), *p.shape), p.dtype), parameters)
        stages = jnp.arange(count), *(jnp.asarray(rows[:count]) for rows in (c, points, a))
        (_, by_x0, total), _ = lax.scan(stage, (by_stages, psi, nothing), stages, reverse=True)
        return total, by_x0

    return x1, pull_step


def _arrays(tableau: diffrax.ButcherTableau, dtype):
    """a, b, e and c of a tableau, as whole arrays."""
    count = len(tableau.b_sol)
    a = np.zeros((count, count))
    for i, row in enumerate(tableau.a_lower, 1):
        a[i, : len(row)] = row
    c = np.concatenate([[0.0], tableau.c])
    return tuple(np.asarray(entries, dtype) for entries in (a, tableau.b_sol, tableau.b_error, c))


def diffrax_adjoint(step: RecordedStep, psi, adjoint: diffrax.AbstractAdjoint) -> StepBack:
    """The same by an adjoint of Diffrax; it knows no errors, so that the exact adjoint is asked for them."""

    def carry_back(solver, pick):
        moved = lambda p, x: _diffrax_step(solver, adjoint, pick(step.system(p)), step.mode, step.t0, step.t1, x)
        return StepBack(*jax.vjp(moved, step.parameters, step.x0)[1](psi))

    done = by_mode(step.solver, step.system(step.parameters), step.mode, carry_back)
    if not step.controlled:
        return done
    return exact_adjoint(step, psi)._replace(total=done.total, psi=done.psi)


def _diffrax_step(solver, adjoint: diffrax.AbstractAdjoint, system, mode, t0, t1, x0):
    """The same step as a solve of Diffrax, which differentiates it."""
    args = (system, mode)
    fixed = diffrax.ConstantStepSize()
    solution = diffrax.diffeqsolve(
        TERM, solver, t0, t1, t1 - t0, x0, args, stepsize_controller=fixed, adjoint=adjoint, max_steps=4, throw=False
    )
    assert solution.ys is not None
    return solution.ys[-1]


def costate_equation(step: RecordedStep, psi, *, rtol, atol, state: str) -> StepBack:
    """psi' = -f_x^T psi, and dJ/dtheta gathers f_theta^T psi, from t1 down to t0 (T7).

    `state`: whether the motion on the way back comes from the "recorded" step or is itself integrated "backward".
    Raises: NotImplementedError for a complex parameter."""
    if any(jnp.iscomplexobj(leaf) for leaf in jax.tree.leaves(step.parameters)):
        raise NotImplementedError(
            "ContinuousCostate() must have real parameters, but one that the motion depends on is complex: use "
            "Replay(), or give its real and its imaginary part."
        )

    def state_at(t, x):
        return x if state == "backward" else step.advance(step.parameters, step.x0, t)

    def backward(s, y, _):
        x, psi, _ = y
        t = step.t1 - s
        f, vjp = jax.vjp(lambda p, x: step.flow(p, t, x), step.parameters, state_at(t, x))
        by_parameters, by_state = vjp(psi)
        return -f, by_state, by_parameters

    x1 = step.advance(step.parameters, step.x0, step.t1)
    start = (x1, psi, jax.tree.map(jnp.zeros_like, step.parameters))
    control = diffrax.PIDController(rtol=rtol, atol=atol)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(backward), diffrax.Tsit5(), jnp.zeros_like(step.t0), step.t1 - step.t0, None, start,
        stepsize_controller=control, adjoint=diffrax.ForwardMode(), max_steps=MOST_STEPS, throw=False,
    )  # fmt: skip
    reached = jnp.where(solution.result == diffrax.RESULTS.successful, 1.0, jnp.nan)
    came_back, psi, by_parameters = jax.tree.map(lambda leaf: reached * leaf[-1], solution.ys)
    if state == "backward":
        missed = jnp.max(jnp.abs(came_back - step.x0) / (atol + rtol * jnp.abs(step.x0)))
        _warn_of_drift(missed)
    return StepBack(by_parameters, psi)


def _warn_of_drift(missed) -> None:
    """Say so where the state, integrated backward over a step, misses the recorded state that it must come back to.

    What is damped forward grows backward: the state that psi was carried along was then another one. `missed` is in
    units of the tolerance.
    """
    reached = missed <= MOST_DRIFT  # False for nan too
    lax.cond(reached, lambda: None, lambda: jax.debug.callback(_drift_warning, reached))


def _drift_warning(reached) -> None:
    if not reached:  # under `jax.vmap` both branches of a `cond` run
        warn_caller(_DRIFT)  # one text for all steps, so that Python shows it once
