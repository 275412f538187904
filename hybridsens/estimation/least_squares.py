"""Gauss-Newton and Levenberg-Marquardt steps (Optimistix), with the Jacobian from forward sensitivities."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jaxtyping import Array, Bool, Float

from ..adjoint.methods import ForwardSensitivities
from .acceleration import geodesic
from .problem import Outcome, Trial

_TAGS: frozenset[object] = frozenset()
_OPTIONS = {"jac": "bwd"}  # the Jacobian comes as an array; "fwd" would keep a program, compiled anew for each fit
FAR, NEAR = 1e-3, 1e-5
"""First damping of Levenberg-Marquardt: at a guess or in a stage, and at a point that stages have led to."""
_SMALL_OFFSET, _SMALL_STEP = 1e-3, 1e-9
"""Of a minimum; see `at_minimum`."""
_NEAR_OFFSET, _NEAR_STEP = 0.1, 1e-4
"""Of a place where steps that have become small may tell of one."""
_ROUNDING = 100
"""Columns of a Jacobian that are so many units of the last place of the longest are rounding."""
_PATIENCE = 12


class _DampingState(eqx.Module):
    step_size: Float[Array, ""]
    """1 / damping."""
    rejected: Bool[Array, ""]
    """Whether the last trial point was rejected."""


class _CautiousTrustRegion(optimistix.ClassicalTrustRegion):
    """Lowers the damping after a good step, but not after the first one that follows a rejection, and raises it faster
    after the second rejection in a row: next to a bound, where p(z) is flat, steps are too long by many powers of ten.

    In a curved valley, damping that falls after every good step makes every other step a rejected one.
    """

    def init(self, y, f_info_struct) -> _DampingState:
        return _DampingState(super().init(y, f_info_struct).step_size, jnp.array(False))

    def step(self, first_step, y, y_eval, f_info, f_eval_info, state: Any):
        size, accept, result, _ = super().step(first_step, y, y_eval, f_info, f_eval_info, state)
        size = jnp.where(accept & state.rejected, jnp.minimum(size, state.step_size), size)
        size = jnp.where(~accept & state.rejected, self.low_constant * size, size)
        return size, accept, result, _DampingState(size, ~accept)


class LevenbergMarquardt(optimistix.LevenbergMarquardt):
    """Levenberg-Marquardt that lowers its damping after every good step, but not after the first one that follows a
    rejection, and whose steps follow a geodesic; see `acceleration.py`.

    `optimistix.LevenbergMarquardt` lowers it only where the reduction comes within 1 % of the predicted one, which
    a motion with impacts hardly ever reaches: it then takes several times as many iterations.
    """

    def __init__(self, rtol: float = 1e-6, atol: float = 1e-6):
        super().__init__(rtol, atol)
        self.search = _CautiousTrustRegion(high_cutoff=0.25, low_cutoff=0.01, high_constant=10.0, low_constant=0.2)


class GaussNewton(optimistix.GaussNewton):
    """Gauss-Newton with a backtracking line search, so that a step that fails or goes uphill is shortened."""

    search: optimistix.BacktrackingArmijo

    def __init__(self, rtol: float = 1e-6, atol: float = 1e-6):
        super().__init__(rtol, atol)
        self.search = optimistix.BacktrackingArmijo(decrease_factor=0.3)


class Carry(NamedTuple):
    """Where a solver stands."""

    z: Float[Array, "unknown"]
    state: Any
    """The Optimistix solver's own state."""
    damping: Float[Array, ""]
    """The first one in the whole problem, relative to the largest diagonal entry of J^T J."""


@eqx.filter_jit
def linearise(problem, z) -> tuple[Float[Array, "residual"], Float[Array, "residual unknown"], Trial]:
    """Residuals, their Jacobian by forward sensitivities, and what happened; failed if any of them is not finite."""

    def value(z):
        r, trial = problem.residuals(z, ForwardSensitivities())
        return r, (r, trial)

    jacobian, (r, trial) = jax.jacfwd(value, has_aux=True)(z)
    return r, jacobian, trial._replace(failed=trial.failed | ~jnp.all(jnp.isfinite(jacobian)))


@eqx.filter_jit
def begin(solver: optimistix.AbstractGaussNewton, z, damping) -> Carry:
    """A solver at z that has evaluated nothing yet; its first step does."""
    nothing = _Linear(jnp.zeros(z.size + 1), jnp.zeros((z.size + 1, z.size)), z)
    state = solver.init(nothing, z, None, _OPTIONS, jax.eval_shape(lambda: nothing.r), None, _TAGS)
    return Carry(z, state, jnp.asarray(damping))


def step(solver: optimistix.AbstractGaussNewton, problem, carry: Carry):
    """Evaluate the next trial point and take it or not: where the solver stands, what happened, (r, J) at that point.

    A trial point that failed has large finite residuals, so that it is rejected.
    """
    at, state = carry.state.y_eval, carry.state
    r, jacobian, trial = linearise(problem, at)
    fn = _Linear(*_punished(trial, state, *compressed(r, jacobian)), at)
    if isinstance(solver.search, optimistix.ClassicalTrustRegion):
        state = _damped(state, jnp.where(jnp.isposinf(trial.end), carry.damping, FAR), fn.jacobian)
    z, new, _ = solver.step(fn, carry.z, None, _OPTIONS, state, _TAGS)
    done, _ = solver.terminate(fn, z, None, _OPTIONS, new, _TAGS)
    # Steps become small at a minimum, but also where the loss jumps: there it still falls towards the jump.
    small_steps = done & ~state.first_step & near_minimum(fn.r, fn.jacobian, at, r.size)
    done = small_steps | at_minimum(fn.r, fn.jacobian, at, r.size)
    accepted = new.num_accepted_steps > state.num_accepted_steps
    residual, slope = new.f_info.residual, new.f_info.jac.as_matrix()
    outcome = Outcome(
        z, 0.5 * jnp.sum(residual**2), jnp.linalg.norm(slope.T @ residual), accepted,
        converged=accepted & ~trial.failed & done, stalled=new.num_steps_since_acceptance >= _PATIENCE,
        first=state.first_step, trial=trial,
    )  # fmt: skip
    if isinstance(solver, LevenbergMarquardt):
        new = _with_geodesic_step(problem, new, outcome, r, jacobian)
    return Carry(z, new, carry.damping), outcome, (r, jacobian)


def _punished(trial: Trial, state, r, jacobian):
    """The same, or for a trial that failed residuals that are larger than those at the point where the solver is."""
    penalty = 10 * (1 + jnp.max(jnp.abs(state.f_info.residual)))
    return jnp.where(trial.failed, penalty, r), jnp.where(trial.failed, 0, jacobian)


def _with_geodesic_step(problem, state, outcome: Outcome, r, jacobian):
    """The solver's state with the next trial point on a geodesic step, after one was taken: r and J are then at z."""
    z, trial = outcome.z, outcome.trial
    go_on = outcome.accepted & ~trial.failed & ~outcome.converged
    damping = 1 / state.search_state.step_size
    move = geodesic(problem.at_stage_end(trial.end), z, state.y_eval - z, r, jacobian, damping, go_on)
    return eqx.tree_at(lambda state: state.y_eval, state, z + move)


def _damped(state, damping, jacobian):
    """The solver's state with its first step size, once a Jacobian is known."""
    largest = jnp.max(jnp.sum(jacobian**2, axis=0))
    first = 1 / (damping * jnp.where((largest > 0) & jnp.isfinite(largest), largest, 1))
    size = state.search_state.step_size
    return eqx.tree_at(lambda s: s.search_state.step_size, state, jnp.where(state.first_step, first, size))


def compressed(
    r: Float[Array, "residual"], jacobian: Float[Array, "residual unknown"]
) -> tuple[Float[Array, "short"], Float[Array, "short unknown"]]:
    """Q^T r and Q^T J from (J, r) = Q R: rows one more than unknowns, with every norm and product that a solver asks
    for. The diagonal of R is positive, so that rows of one iteration compare with those of the next."""
    R = jnp.linalg.qr(jnp.column_stack([jacobian, r]), mode="r")
    R = jnp.where(jnp.diag(R) < 0, -1, 1)[:, None] * R
    R = jnp.pad(R, ((0, R.shape[1] - R.shape[0]), (0, 0)))
    return R[:, -1], R[:, :-1]


def at_minimum(
    r: Float[Array, "short"], jacobian: Float[Array, "short unknown"], z: Float[Array, "unknown"], n: int
) -> Bool[Array, ""]:
    """Whether `compressed` r and J of n residuals are those of a minimum.

    By Bates and Watts' relative offset. At 1e-3 the distance to the minimum is about a thousandth of the statistical
    uncertainty. Residuals that vanish altogether make it useless; then the Gauss-Newton step counts, once it is
    rounding of z.
    """
    offset, step = _offset_and_step(r, jacobian, z, n)
    return (offset < _SMALL_OFFSET) | (step < _SMALL_STEP)


def near_minimum(r, jacobian, z, n: int) -> Bool[Array, ""]:
    """The same, roughly: within a tenth of the statistical uncertainty."""
    offset, step = _offset_and_step(r, jacobian, z, n)
    return (offset < _NEAR_OFFSET) | (step < _NEAR_STEP)


def is_near_minimum(problem, z) -> bool:
    """The same of a problem at z."""
    r, jacobian, trial = linearise(problem, z)
    return not bool(trial.failed) and bool(near_minimum(*compressed(r, jacobian), z, r.size))


def _offset_and_step(r, jacobian, z, n: int) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Bates and Watts' relative offset, |r in the tangent plane| / |r across it| per degree of freedom; and the
    largest entry of the Gauss-Newton step, each relative to that of z, or to 1."""
    p, length = jacobian.shape[1], jnp.linalg.norm(jacobian, axis=0)
    # An unknown whose guess is far too small has a short column: it counts as all do, unless it is rounding.
    length = jnp.where(length > _ROUNDING * jnp.finfo(r.dtype).eps * jnp.max(length), length, jnp.inf)
    u, s, vt = jnp.linalg.svd(jacobian / length, full_matrices=False)
    seen = s > 1e-10 * s[0]
    inside = jnp.where(seen, u.T @ r, 0)
    across = jnp.maximum(jnp.sum(r**2) - jnp.sum(inside**2), 0)
    offset = jnp.sqrt(jnp.sum(inside**2) / p / (across / max(n - p, 1) + jnp.finfo(r.dtype).tiny))
    step = vt.T @ (inside / jnp.where(seen, s, 1)) / length
    return offset, jnp.max(jnp.abs(step) / (1 + jnp.abs(z)))


class _Linear(eqx.Module):
    """r + J (z - z0). The solver asks for value and Jacobian at the one point z0, so this serves it."""

    r: Array
    jacobian: Array
    z: Array

    def __call__(self, z, args):
        del args
        return self.r + self.jacobian @ (z - self.z), None
