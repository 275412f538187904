"""Which horizon strategy for which motion? Fits of the oscillator with a stop, records by SciPy, noise of 1 %.

- "short": 5 impacts in 20 s, six parameters.
- "drive known": the same, five parameters; the frequency of the drive is known.
- "chaotic": 10 impacts in 40 s, of which the last second depends on the distance of the stop 20 000-fold; stiffness,
  damping, distance and restitution.

A fit succeeds if every parameter ends within 4 standard errors of the truth and its residuals are noise.

Run: python -m benchmarks.fit_strategies --records 10
"""

import argparse
import csv
import time
from pathlib import Path
from typing import NamedTuple

import hybridsens as hs

hs.configure()

import numpy as np  # noqa: E402

from benchmarks.fit_record import BOUNDS, TIMES, TRUTH, positions  # noqa: E402
from benchmarks.machine import describe  # noqa: E402
from hybridsens.scenes import ElasticStop  # noqa: E402
from hybridsens.study.fit import GrowingHorizon, MultipleShooting, fit, measurements  # noqa: E402

RESULTS = Path(__file__).parents[1] / "results" / "fit_strategies.csv"


class Motion(NamedTuple):
    """A truth, what of it is fitted, and when it is measured."""

    truth: dict[str, float]
    fitted: tuple[str, ...]
    times: np.ndarray


FREE = ("stiffness", "damping", "distance", "restitution_coefficient")
MOTIONS = {
    "short": Motion(TRUTH, tuple(TRUTH), TIMES),
    "drive known": Motion(TRUTH, tuple(name for name in TRUTH if name != "frequency"), TIMES),
    "chaotic": Motion(
        TRUTH | {"damping": 0.05, "frequency": 2.2, "distance": 0.301}, FREE, np.linspace(0.1, 40.0, 400)
    ),
}  # fmt: skip
STRATEGIES = {
    "none": None,
    "growing": GrowingHorizon(),
    "growing slowly": GrowingHorizon(first=0.1, trust=0.5, steps=2),
    "shooting, 4 windows": MultipleShooting(),
    "shooting, 8 windows": MultipleShooting(windows=8),
}


def guess(motion: Motion, seed: int, error: float) -> ElasticStop:
    """Fitted parameters off by up to `error`."""
    off = error * np.random.default_rng(1_000_000 + seed).uniform(-1, 1, len(motion.fitted))
    values = {name: motion.truth[name] * (1 + x) for name, x in zip(motion.fitted, off, strict=True)}
    values["restitution_coefficient"] = min(values["restitution_coefficient"], 0.98)
    return ElasticStop(**motion.truth | values)


def row(motion_name: str, strategy_name: str, error: float, records: int) -> dict:
    """One strategy on all records of one motion."""
    motion = MOTIONS[motion_name]
    q, _ = positions(motion.truth, motion.times)
    sigma, truth = 0.01 * np.max(np.abs(q)), np.array([motion.truth[name] for name in motion.fitted])
    good, iterations, begin = 0, [], time.perf_counter()
    for seed in range(records):
        data = measurements(motion.times, q + sigma * np.random.default_rng(seed).normal(size=q.size), sigma=sigma)
        try:
            found = fit(guess(motion, seed, error), data, parameters=motion.fitted, rtol=1e-10, atol=1e-10,
                        bounds={name: BOUNDS[name] for name in motion.fitted}, max_events=64,
                        strategy=STRATEGIES[strategy_name])  # fmt: skip
        except ValueError:
            continue
        near = np.all(np.abs(found.values - truth) <= 4 * found.uncertainty.standard_errors)
        good += bool(near) and found.uncertainty.noise < 1.3
        iterations.append(found.iterations)
    return {
        "motion": motion_name, "strategy": strategy_name, "guess off by": error, "records": records, "recovered": good,
        "iterations, median": float(np.median(iterations)), "seconds each": (time.perf_counter() - begin) / records,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=10)
    parser.add_argument("--motions", nargs="+", default=list(MOTIONS), choices=list(MOTIONS))
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES), choices=list(STRATEGIES))
    parser.add_argument("--error", type=float, nargs="+", default=[0.3])
    asked = parser.parse_args()
    cases = [(m, s, e) for m in asked.motions for e in asked.error for s in asked.strategies]
    RESULTS.parent.mkdir(exist_ok=True)
    with RESULTS.open("w", newline="") as file:
        for case in cases:
            found = {**row(*case, asked.records), **describe()}
            writer = csv.DictWriter(file, list(found))
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(found)
            print(*case, f"{found['recovered']} of {asked.records}, iterations {found['iterations, median']:.0f}, "
                  f"{found['seconds each']:.2f} s each", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
