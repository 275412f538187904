"""The adjoint of one recorded step: exact replay, the continuous costate (T7), or an adjoint of Diffrax."""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax

from ..forward.explicit import by_mode
from ..forward.solver import TERM, one_step, step_with_error
from .methods import AbstractGradientMethod, ContinuousCostate, DiffraxAdjoint


class StepBack(NamedTuple):
    """What a costate becomes over one step."""

    total: Any
    """What the step adds to dJ/dtheta."""
    psi: Any
    """psi at its start."""
    x1: Any
    """The state at its end."""
    total_error: Any = None
    """Estimated error of `total`; None where the method controls its error by itself."""
    psi_error: Any = None


StepAdjoint = Callable[..., StepBack]
"""(parameters, static, mode, t0, t1, x0, psi1) -> StepBack"""


def step_adjoint(method: AbstractGradientMethod, solver: diffrax.AbstractSolver, controlled: bool) -> StepAdjoint:
    """How the method carries a costate back over one step of the solver, with its error where that is `controlled`."""
    if isinstance(method, ContinuousCostate):
        return _continuous_costate(method, solver)
    if isinstance(method, DiffraxAdjoint):
        by_diffrax = _vjp_of(solver, lambda solver, *step: _diffrax_step(solver, method.adjoint, *step))
        return _with_error_of(_replay(solver), by_diffrax) if controlled else by_diffrax
    return _replay(solver) if controlled else _vjp_of(solver, one_step)


def _with_error_of(judge: StepAdjoint, adjoint: StepAdjoint) -> StepAdjoint:
    """One way back, with the error that another one estimates."""

    def both(*step):
        done = adjoint(*step)
        return judge(*step)._replace(total=done.total, psi=done.psi, x1=done.x1)

    return both


def _replay(solver: diffrax.AbstractSolver) -> StepAdjoint:
    """Phi_x^T psi and Phi_theta^T psi of a step Phi, and the same of its error estimate E."""

    def adjoint(parameters, static, mode, t0, t1, x0, psi):
        def carry_back(solver, pick):
            system = lambda p: pick(eqx.combine(p, static))
            step = lambda p, x: step_with_error(solver, system(p), mode, t0, t1, x)
            (x1, _), of_step = jax.vjp(step, parameters, x0)
            x1, of_projection = jax.vjp(lambda p, x: system(p).project(t1, x, mode), parameters, x1)
            by_projection, psi_1 = of_projection(psi)  # only what stays on the constraints matters, of the error too
            zero = jnp.zeros_like(psi)
            both = jax.vmap(of_step)((jnp.stack([psi_1, zero]), jnp.stack([zero, psi_1])))  # one copy to compile
            total, psi_0 = jax.tree.map(lambda pair: pair[0], both)
            total_error, psi_error = jax.tree.map(lambda pair: pair[1], both)
            return StepBack(jax.tree.map(jnp.add, total, by_projection), psi_0, x1, total_error, psi_error)

        return by_mode(solver, eqx.combine(parameters, static), mode, carry_back)

    return adjoint


def _vjp_of(solver: diffrax.AbstractSolver, step) -> StepAdjoint:
    def adjoint(parameters, static, mode, t0, t1, x0, psi):
        def carry_back(solver, pick):
            moved = lambda p, x: step(solver, pick(eqx.combine(p, static)), mode, t0, t1, x)
            x1, pull = jax.vjp(moved, parameters, x0)
            total, psi_0 = pull(psi)
            return StepBack(total, psi_0, x1)

        return by_mode(solver, eqx.combine(parameters, static), mode, carry_back)

    return adjoint


def _diffrax_step(solver, adjoint: diffrax.AbstractAdjoint, system, mode, t0, t1, x0):
    """The same step as a solve of Diffrax, which differentiates it."""
    args = (system, mode)
    fixed = diffrax.ConstantStepSize()
    solution = diffrax.diffeqsolve(
        TERM, solver, t0, t1, t1 - t0, x0, args, stepsize_controller=fixed, adjoint=adjoint, max_steps=4, throw=False
    )
    assert solution.ys is not None
    return solution.ys[-1]


def _continuous_costate(method: ContinuousCostate, solver) -> StepAdjoint:
    def adjoint(parameters, static, mode, t0, t1, x0, psi):
        """psi' = -f_x^T psi, and dJ/dtheta gathers f_theta^T psi, from t1 down to t0 (T7)."""

        def state_at(t, x):
            return (
                x if method.state == "backward" else one_step(solver, eqx.combine(parameters, static), mode, t0, t, x0)
            )

        def backward(s, y, _):
            x, psi, _ = y
            t = t1 - s
            flow = lambda p, x: eqx.combine(p, static).flow(t, x, mode)
            f, vjp = jax.vjp(flow, parameters, state_at(t, x))
            by_parameters, by_state = vjp(psi)
            return -f, by_state, by_parameters

        x1 = one_step(solver, eqx.combine(parameters, static), mode, t0, t1, x0)
        start = (x1, psi, jax.tree.map(jnp.zeros_like, parameters))
        control = diffrax.PIDController(rtol=method.rtol, atol=method.atol)
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(backward), diffrax.Tsit5(), jnp.zeros_like(t0), t1 - t0, None, start,
            stepsize_controller=control, adjoint=diffrax.ForwardMode(), max_steps=MOST_STEPS, throw=False,
        )  # fmt: skip
        reached = jnp.where(solution.result == diffrax.RESULTS.successful, 1.0, jnp.nan)
        came_back, psi, by_parameters = jax.tree.map(lambda leaf: reached * leaf[-1], solution.ys)
        if method.state == "backward":
            _warn_of_drift(method, came_back, x0)
        return StepBack(by_parameters, psi, x1)

    return adjoint


MOST_STEPS = 4096
"""How many steps psi may take over one recorded step; one that needs more makes the gradient nan."""

MOST_DRIFT = 1e3
"""By how many times its tolerance a state that is integrated backward over a step may miss the recorded one."""


def _warn_of_drift(method: ContinuousCostate, came_back, x0) -> None:
    """Say so where the state, integrated backward over a step, misses the recorded state that it must come back to.

    What is damped forward grows backward: the state that psi was carried along was then another one.
    """
    missed = jnp.max(jnp.abs(came_back - x0) / (method.atol + method.rtol * jnp.abs(x0)))
    reached = missed <= MOST_DRIFT  # False for nan too
    lax.cond(reached, lambda: None, lambda: jax.debug.callback(_drift_warning, reached))


def _drift_warning(reached) -> None:
    if not reached:  # under `jax.vmap` both branches of a `cond` run
        warnings.warn(_DRIFT, stacklevel=2)  # one text for all steps, so that Python shows it once


_DRIFT = (
    f'ContinuousCostate(state="backward") misses recorded states by more than {MOST_DRIFT:.0e} times its tolerance: '
    "the motion is too dissipative to be integrated backward, and the gradient is wrong. "
    'Use ContinuousCostate(state="recorded") or Replay().'
)
