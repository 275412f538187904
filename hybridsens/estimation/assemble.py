"""From where an optimizer ended to a result: residuals, derivative by the parameters themselves, uncertainty."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .data import Measurements
from .descend import Run
from .growing import Growing
from .history import event_sequence
from .iterate import iterate
from .least_squares import linearise
from .motions import event_rows
from .optimizers import Method
from .problem import Problem, predict
from .result import FitResult
from .starts import Starts
from .uncertainty import Noise, uncertainty

_EXACT = 1e-7
"""Residuals of so small a part of the data's range are errors of the computation (its tolerance is 1e-8), no noise."""


def build_result(
    how: Method | Growing, problem: Problem, data: Measurements, guess, descents: Sequence[Run],
    starts: Starts | None,
) -> FitResult:  # fmt: skip
    """The result of the last of these descents; the ones before it were stages."""
    last, selection = descents[-1], problem.selection
    plain = eqx.tree_at(lambda p: p.robust, problem, jnp.asarray(jnp.inf))
    r, jacobian = _linearised(how, plain, last.z)
    measured = data.values.size + data.event_times.size
    values, by_z = jax.jvp(selection.to_values, (last.z,), (jnp.ones_like(last.z),))
    # A parameter driven onto its bound does not answer to z any more: nothing is known about it.
    by_p = np.where(by_z == 0, 0, np.asarray(jacobian) / np.where(by_z == 0, 1, by_z))[:measured]
    known = np.isfinite(np.concatenate([np.ravel(data.values), data.event_times]))
    sigmas_given = data.sigmas is not None or not data.names
    rounding = 0.0 if sigmas_given else _rounding(data, by_p.dtype)
    knowledge = uncertainty(
        selection.labels, values, np.asarray(r)[:measured][known], by_p[known], np.asarray(problem.prior.weight),
        Noise(sigmas_given, float(problem.robust), _largest(data), rounding),
    )  # fmt: skip
    residuals, event_residuals = _in_units(np.asarray(r)[:measured], data)
    trajectory, predictions = predict(problem, last.z)
    missing = np.isfinite(data.event_times) & ~np.any(problem.matches(event_rows(trajectory)), axis=1)
    return FitResult(
        scene=problem.scene_at(last.z), labels=selection.labels, values=np.asarray(values),
        guess=np.asarray(selection.to_values(guess)),
        on_bound=tuple(label for label, slope in zip(selection.labels, np.asarray(by_z), strict=True) if slope == 0),
        loss=last.loss, residuals=residuals, event_residuals=event_residuals,
        events_missing=np.flatnonzero(missing), jacobian=by_p, uncertainty=knowledge,
        history=[line for descent in descents for line in descent.history], stopped=last.stopped,
        sequence_start=event_sequence(event_rows(predict(problem, guess)[0])), sequence_end=last.end, data=data,
        trajectory=trajectory, predictions=np.asarray(predictions), starts=starts,
    )  # fmt: skip


def _largest(data: Measurements) -> float:
    """The largest datum in sigmas, to measure by what rounding of the Jacobian is."""
    sigmas = 1.0 if data.sigmas is None else data.sigmas
    parts = (np.ravel(data.values / sigmas), data.event_times / data.event_sigmas)
    return float(np.nanmax(np.abs(np.concatenate(parts))))


def _rounding(data: Measurements, dtype) -> float:
    """How large residuals of exact data may be: some digits more than motions are computed with, of the data's range,
    or of the data themselves where they all are one number."""
    spread = np.nanmax(np.nanstd(data.values, axis=0))
    return float(max(_EXACT, 10 * np.finfo(dtype).eps) * (spread or np.nanmax(np.abs(data.values))))


def _in_units(r: np.ndarray, data: Measurements) -> tuple[np.ndarray, np.ndarray]:
    sigmas = np.ones_like(data.values) if data.sigmas is None else data.sigmas
    seen = np.where(np.isfinite(data.values), r[: data.values.size].reshape(data.values.shape) * sigmas, np.nan)
    events = np.where(np.isfinite(data.event_times), r[data.values.size :] * data.event_sigmas, np.nan)
    return seen, events


def _linearised(how: Method | Growing, problem: Problem, z):
    """Residuals and Jacobian, by the program that the iterations have compiled."""
    if not how.least_squares:
        return linearise(problem, z)[:2]
    return iterate(how, problem, how.begin(z, stages=False), 1, 1).linearised
