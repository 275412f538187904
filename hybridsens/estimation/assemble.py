"""From where an optimizer ended to a result: residuals, derivative by the parameters themselves, uncertainty.

Bounds are kept by a transformation that is flat on them (`parameters.py`), so the optimizer comes close to a bound, and
its own measures of convergence do not see that it has arrived. They are asked anew, by the parameters themselves."""

import dataclasses
import functools
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .data import Measurements
from .descend import UNFINISHED, Run, event_sequence
from .growing import Growing
from .iterate import iterate
from .least_squares import at_minimum, compressed, linearise
from .motions import event_rows
from .optimizers import Method
from .parameters import Selection
from .problem import FitProblem, predict
from .result import FitResult
from .sizes import EXACT, largest_datum
from .starts import Starts
from .uncertainty import Noise, Uncertainty, uncertainty, with_held


def build_result(
    method: Method | Growing, problem: FitProblem, data: Measurements, guess, descents: Sequence[Run],
    starts: Starts | None,
) -> FitResult:  # fmt: skip
    """The result of the last of these descents; the ones before it were stages."""
    last, selection = descents[-1], problem.selection
    values = np.asarray(selection.to_values(last.z))
    minimised = by_parameters(method, problem, last.z)
    held = held_on_bound(problem, values, *minimised, data.sigmas_known)
    arrived = held.any() and last.stopped in UNFINISHED and others_at_minimum(selection, values, *minimised, held)
    measured = data.values.size + data.event_times.size
    squared = by_parameters(method, plain(problem), last.z) if np.isfinite(problem.robust) else minimised
    r, jacobian = (rows[:measured] for rows in squared)
    residuals, event_residuals = _in_units(r, data)
    trajectory, predictions = predict(problem, last.z)
    missing = np.isfinite(data.event_times) & ~np.any(problem.matches(event_rows(trajectory)), axis=1)
    return FitResult(
        scene=problem.scene_at(last.z), labels=selection.labels, values=values,
        guess=np.asarray(selection.to_values(guess)),
        on_bound=tuple(np.array(selection.labels)[held].tolist()),
        loss=last.loss, residuals=residuals, event_residuals=event_residuals,
        events_missing=np.flatnonzero(missing), jacobian=jacobian,
        uncertainty=_knowledge(problem, data, values, r, jacobian, held),
        history=[line for descent in descents for line in descent.history],
        stopped="converged" if arrived else last.stopped,
        sequence_start=event_sequence(event_rows(predict(problem, guess)[0])), sequence_end=last.end, data=data,
        trajectory=trajectory, predictions=np.asarray(predictions),
        horizon=(float(problem.t0), float(problem.horizon)), starts=starts,
        again=functools.partial(_at_other_times, problem, last.z),
    )  # fmt: skip


def _at_other_times(problem: FitProblem, z, times: Float[Array, "sample"]) -> Float[np.ndarray, "sample observation"]:
    """What the motion at z shows then."""
    asked = eqx.tree_at(lambda p: p.data.times, problem, times)
    return np.asarray(predict(asked, z)[1])


def _knowledge(problem: FitProblem, data: Measurements, values, r, jacobian, held) -> Uncertainty:
    """How well the parameters are known, those that are held on a bound being none."""
    known, free = np.isfinite(np.concatenate([np.ravel(data.values), data.event_times])), ~held
    rounding = 0.0 if data.sigmas_known else _rounding(data, jacobian.dtype)
    scale = np.asarray(problem.selection.scale)[free]
    noise = Noise(data.sigmas_known, float(problem.robust), largest_datum(data), rounding, scale)
    labels, weight = np.array(problem.selection.labels)[free].tolist(), np.asarray(problem.prior.weight)[free]
    return with_held(uncertainty(labels, values[free], r[known], jacobian[known][:, free], weight, noise), held)


def _rounding(data: Measurements, dtype) -> float:
    """How large residuals of exact data may be: some digits more than motions are computed with, of the data's range,
    or of the data themselves where they all are one number."""
    return float(max(EXACT, 10 * np.finfo(dtype).eps) * (data.spread or np.nanmax(np.abs(data.values))))


def _in_units(r: np.ndarray, data: Measurements) -> tuple[np.ndarray, np.ndarray]:
    sigmas = np.ones_like(data.values) if data.sigmas is None else data.sigmas
    seen = np.where(np.isfinite(data.values), r[: data.values.size].reshape(data.values.shape) * sigmas, np.nan)
    events = np.where(np.isfinite(data.event_times), r[data.values.size :] * data.event_sigmas, np.nan)
    return seen, events


_OF_ERROR, _OF_SIZE = 1e-2, 1e-6
"""A parameter is on its bound within this part of its standard error, or of its size."""


def by_parameters(
    method: Method | Growing, problem: FitProblem, z
) -> tuple[Float[np.ndarray, "residual"], Float[np.ndarray, "residual parameter"]]:
    """Residuals and their derivative by the parameters p themselves, by the program that the iterations have compiled.

    Without bounds p = scale z, also where bounds would make p(z) flat. The scales are powers of two, so that no
    rounding moves p beyond its bound.
    """
    selection = problem.selection
    scale = np.exp2(np.floor(np.log2(selection.scale)))
    lower, upper = np.full_like(selection.lower, -np.inf), np.full_like(selection.upper, np.inf)
    free = dataclasses.replace(selection, lower=lower, upper=upper, scale=scale)
    r, jacobian = _linearised(method, dataclasses.replace(problem, selection=free), selection.to_values(z) / scale)
    return np.asarray(r), np.asarray(jacobian) / scale


def plain(problem: FitProblem) -> FitProblem:
    """The same with all residuals squared."""
    return eqx.tree_at(lambda p: p.robust, problem, jnp.asarray(jnp.inf))


def held_on_bound(problem: FitProblem, values, r, jacobian, sigmas_given: bool) -> Bool[np.ndarray, "parameter"]:
    """Which parameters are on a bound, beyond which the loss goes on falling.

    They are next to it, and a Newton step in that parameter alone, -(J^T r) / (J^T J), leads beyond it.
    """
    selection = problem.selection
    curvature = np.sum(jacobian**2, axis=0)
    seen = np.where(curvature > 0, curvature, np.inf)
    step = -(jacobian.T @ r) / seen
    noise = 1.0 if sigmas_given else np.sqrt(np.sum(r**2) / max(r.size - np.size(values), 1))
    near = np.maximum(_OF_ERROR * noise / np.sqrt(seen), _OF_SIZE * np.asarray(selection.scale))
    p, lower, upper = np.asarray(values), np.asarray(selection.lower), np.asarray(selection.upper)
    below, above = (p - lower <= near) & (p + step < lower), (upper - p <= near) & (p + step > upper)
    return below | above


def others_at_minimum(selection: Selection, values, r, jacobian, held: Bool[np.ndarray, "parameter"]) -> bool:
    """Whether the parameters that are not held are at a minimum, if those held stay where they are."""
    if held.all():
        return True
    p = np.asarray(values)[~held]
    size = np.where(p == 0, np.asarray(selection.scale)[~held], np.abs(p))
    short, slope = compressed(jnp.asarray(r), jnp.asarray(jacobian[:, ~held] * size))
    return bool(at_minimum(short, slope, jnp.asarray(p / size), r.size))


def _linearised(method: Method | Growing, problem: FitProblem, z) -> tuple[Array, Array]:
    if not method.least_squares:
        return linearise(problem, z)[:2]
    return iterate(method, problem, method.begin(z, stages=False), 1, 1).linearised
