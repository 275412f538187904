"""From where an optimizer ended to a result: residuals, derivative by the parameters themselves, uncertainty."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...simulate import simulate
from .data import Measurements
from .descend import Descent
from .least_squares import linearise
from .problem import Problem
from .result import FitResult
from .starts import Starts
from .uncertainty import uncertainty
from .watch import event_sequence


def assemble(
    problem: Problem, data: Measurements, guess, descents: Sequence[Descent], starts: Starts | None
) -> FitResult:
    """The result of the last of these descents; the ones before it were stages."""
    last, selection = descents[-1], problem.selection
    plain = eqx.tree_at(lambda p: p.robust, problem, jnp.asarray(jnp.inf))
    r, jacobian, _ = linearise(plain, last.z)
    _, _, at_guess = linearise(plain, guess)
    measured = data.values.size + data.event_times.size
    values, by_z = jax.jvp(selection.to_values, (last.z,), (jnp.ones_like(last.z),))
    # A parameter driven onto its bound does not answer to z any more: nothing is known about it.
    by_p = np.where(by_z == 0, 0, np.asarray(jacobian) / np.where(by_z == 0, 1, by_z))[:measured]
    known = np.concatenate([np.ravel(np.isfinite(data.values)), np.ones(data.event_times.size, bool)])
    knowledge = uncertainty(
        selection.labels, values, np.asarray(r)[:measured][known], by_p[known], np.asarray(problem.prior.weight),
        sigmas_given=data.sigmas is not None or not data.names, robust=float(problem.robust),
    )  # fmt: skip
    residuals, event_residuals = _in_units(np.asarray(r)[:measured], data)
    scene = problem.scene_at(last.z)
    return FitResult(
        scene=scene, labels=selection.labels, values=np.asarray(values), guess=np.asarray(selection.to_values(guess)),
        loss=last.loss, residuals=residuals, event_residuals=event_residuals, jacobian=by_p, uncertainty=knowledge,
        history=[line for descent in descents for line in descent.history], stopped=last.stopped,
        sequence_start=event_sequence(at_guess), sequence_end=last.end, data=data, trajectory=_trajectory(problem,
        scene),
        starts=starts, carry=last.carry,
    )  # fmt: skip


def _in_units(r: np.ndarray, data: Measurements) -> tuple[np.ndarray, np.ndarray]:
    sigmas = np.ones_like(data.values) if data.sigmas is None else data.sigmas
    seen = np.where(np.isfinite(data.values), r[: data.values.size].reshape(data.values.shape) * sigmas, np.nan)
    return seen, r[data.values.size :] * data.event_sigmas


def _trajectory(problem: Problem, scene):
    numerics = problem.numerics
    return simulate(
        scene, problem.initial_state(scene), t0=problem.t0, t1=problem.horizon,
        ts=problem.data.times if problem.data.times.size else None, solver=numerics.solver, rtol=numerics.rtol,
        atol=numerics.atol, max_events=numerics.max_events, max_steps=numerics.max_steps, throw=False,
    )  # fmt: skip
