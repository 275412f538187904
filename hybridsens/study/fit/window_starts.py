"""Where windows of multiple shooting begin, and in which state: read off the measurements where they show it."""

from typing import NamedTuple

import numpy as np

from ...adjoint.methods import Replay
from .prepare import StateObserver
from .problem import Problem

_NEAR = 7


class Parabolas(NamedTuple):
    """Parabolas through the seven measurements nearest to each sample."""

    value: np.ndarray
    slope: np.ndarray
    misfit: np.ndarray
    """Root mean square of what is left; large where an impact is near."""
    reach: np.ndarray
    """How far away the farthest of the seven is [s]; large beside a gap in the data."""


def edges_away_from_kinks(problem: Problem, windows: int) -> np.ndarray:
    """Samples at which windows 1, 2, ... begin: near equal parts, where the measured coordinates are smoothest.

    A window that begins beside an impact may have it twice or not at all, and never mends that.
    """
    samples = problem.data.times.shape[0]
    nominal = np.round(samples * np.arange(1, windows) / windows).astype(int)
    rough = [_roughness(problem, column) for column, _ in _coordinates(problem)]
    if not rough:
        return nominal
    reach = _reach(samples, windows)
    choices = [np.arange(middle - reach, middle + reach + 1) for middle in nominal]
    return np.array([near[np.argmin(np.max(rough, axis=0)[near])] for near in choices])


def _reach(samples: int, windows: int) -> int:
    """How many samples a window's beginning may be moved."""
    return samples // (4 * windows)


def longest_window(samples: int, windows: int) -> int:
    """Samples that a window may have at most, wherever the windows begin."""
    return -(-samples // windows) + 2 * _reach(samples, windows) + 1


def states(problem: Problem, z) -> np.ndarray:
    """(sample, state): measured where the coordinates were, with slopes as velocities; the guess's motion elsewhere."""
    scene = problem.scene_at(z)
    motion = problem.motion(scene, Replay())
    assert motion.q is not None and motion.v is not None  # there are samples
    found = np.concatenate([motion.q, motion.v], axis=1)
    dof = found.shape[1] // 2
    for column, pick in _coordinates(problem):
        parabola = parabolas(problem, column)
        found[:, pick] = parabola.value
        if pick < dof and pick + dof not in problem.observe.picks:
            found[:, pick + dof] = parabola.slope
    return found


def parabolas(problem: Problem, column: int) -> Parabolas:
    """Around every sample, from the measurements of one column."""
    at, known = np.asarray(problem.data.times), np.asarray(problem.data.weights)[:, column] > 0
    times, values = at[known], np.asarray(problem.data.values)[known, column]
    near = np.argsort(np.abs(times - at[:, None]), axis=1)[:, : min(_NEAR, times.size)]
    return Parabolas(*np.array([_parabola(times[n] - t, values[n]) for t, n in zip(at, near, strict=True)]).T)


def _parabola(t: np.ndarray, y: np.ndarray) -> tuple[float, float, float, float]:
    c = np.polynomial.Polynomial.fit(t, y, min(2, t.size - 1))
    return c(0.0), c.deriv()(0.0), float(np.sqrt(np.mean((c(t) - y) ** 2))), np.max(np.abs(t))


def _coordinates(problem: Problem) -> list[tuple[int, int]]:
    """(column, entry of the state) of what is measured directly."""
    return list(enumerate(problem.observe.picks)) if isinstance(problem.observe, StateObserver) else []


def _roughness(problem: Problem, column: int) -> np.ndarray:
    """Misfits of parabolas in spreads of the column; inf beside gaps in the data."""
    around, known = parabolas(problem, column), np.asarray(problem.data.weights)[:, column] > 0
    spread = float(np.std(np.asarray(problem.data.values)[known, column])) or 1.0
    return np.where(around.reach < 1.5 * np.median(around.reach), around.misfit / spread, np.inf)
