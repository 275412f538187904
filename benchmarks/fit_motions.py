"""Motions of the oscillator with a stop that fits are tried on: truths, noisy records by SciPy, and guesses.

- "short": 5 impacts in 20 s, six parameters.
- "drive known": the same, five parameters; the frequency of the drive is known.
- "chaotic": 10 impacts in 40 s, of which the last second depends on the distance of the stop 20 000-fold; stiffness,
  damping, distance and restitution.
- "long chaotic": the same for 60 s, 15 impacts, 1 100 000-fold.
"""

from typing import NamedTuple

import numpy as np

from hybridsens.estimation import GrowingHorizon, measurements, prepare
from hybridsens.estimation.data import Measurements
from hybridsens.estimation.problem import Problem
from hybridsens.scenes import ElasticStop
from tests.problems.stop_record import BOUNDS, TIMES, TRUTH, positions


class Motion(NamedTuple):
    """A truth, what of it is fitted, when it is measured, and the horizon strategy that suits it."""

    truth: dict[str, float]
    fitted: tuple[str, ...]
    times: np.ndarray
    growing: GrowingHorizon

    @property
    def values(self) -> np.ndarray:
        """The truth of what is fitted."""
        return np.array([self.truth[name] for name in self.fitted])

    @property
    def bounds(self) -> dict:
        """Of what is fitted."""
        return {name: BOUNDS[name] for name in self.fitted}


SLOWLY = GrowingHorizon(first=0.1, trust=0.25, steps=3)
CHAOTIC = Motion(
    TRUTH | {"damping": 0.05, "frequency": 2.2, "distance": 0.301},
    ("stiffness", "damping", "distance", "restitution_coefficient"), np.linspace(0.1, 40.0, 400), SLOWLY,
)  # fmt: skip
MOTIONS = {
    "short": Motion(TRUTH, tuple(TRUTH), TIMES, GrowingHorizon()),
    "drive known": Motion(TRUTH, tuple(name for name in TRUTH if name != "frequency"), TIMES, GrowingHorizon()),
    "chaotic": CHAOTIC,
    "long chaotic": CHAOTIC._replace(times=np.linspace(0.1, 60.0, 600)),
}


def record(motion: Motion, seed: int) -> Measurements:
    """Positions with noise of 1 % of the amplitude."""
    q, _ = positions(motion.truth, motion.times)
    sigma = 0.01 * np.max(np.abs(q))
    return measurements(motion.times, q + sigma * np.random.default_rng(seed).normal(size=q.size), sigma=sigma)


def guess(motion: Motion, seed: int, error: float = 0.3, kind: str = "uniform") -> ElasticStop:
    """Fitted parameters off by up to `error` ("uniform"), or by exactly `error` with random signs ("corner")."""
    random, count = np.random.default_rng(1_000_000 + seed), len(motion.fitted)
    off = error * (random.uniform(-1, 1, count) if kind == "uniform" else random.choice([-1, 1], count))
    values = dict(zip(motion.fitted, motion.values * (1 + off), strict=True))
    values["restitution_coefficient"] = min(values["restitution_coefficient"], 0.98)
    return ElasticStop(**motion.truth | values)


def problem(motion: Motion, seed: int, error: float, tolerance: float) -> Problem:
    """The least-squares problem of a record, at a guess that is off."""
    experiment = prepare.Experiment(settings=prepare.SETTINGS | dict(rtol=tolerance, atol=tolerance))
    unknowns = prepare.Unknowns(motion.fitted, motion.bounds)
    return prepare.build_problem(guess(motion, seed, error), record(motion, seed), unknowns, experiment)
