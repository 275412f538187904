"""Which horizon strategy for which motion? Fits of the oscillator with a stop, records by SciPy, noise of 1 %;
see `fit_motions.py`.

A fit succeeds if every parameter ends within 4 standard errors of the truth and its residuals are noise.

Run: python -m benchmarks.fit_strategies --records 10
"""

import argparse
import itertools
import time

import hybridsens as hs

hs.configure()

import numpy as np  # noqa: E402

from benchmarks.fit_motions import MOTIONS, SLOWLY, guess, record  # noqa: E402
from benchmarks.rows import show, write  # noqa: E402
from hybridsens.estimation import GrowingHorizon, fit  # noqa: E402

STRATEGIES = {
    "none": None,
    "growing": GrowingHorizon(),
    "growing slowly": SLOWLY,
}


def row(motion_name: str, strategy_name: str, error: float, records: int) -> dict:
    """One strategy on all records of one motion."""
    motion = MOTIONS[motion_name]
    good, iterations, seconds = 0, [], []
    for seed in range(records):
        data, begin = record(motion, seed), time.perf_counter()
        try:
            found = fit(guess(motion, seed, error), data, parameters=motion.fitted, rtol=1e-10, atol=1e-10,
                        bounds=motion.bounds, max_events=64, strategy=STRATEGIES[strategy_name])  # fmt: skip
        except ValueError:
            continue
        seconds.append(time.perf_counter() - begin)
        near = np.all(np.abs(found.values - motion.values) <= 4 * found.uncertainty.standard_errors)
        good += bool(near) and found.uncertainty.noise < 1.3
        iterations.append(found.iterations)
    return {
        "motion": motion_name, "strategy": strategy_name, "guess off by": error, "records": records, "recovered": good,
        "iterations, median": float(np.median(iterations)), "seconds, median": float(np.median(seconds)),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=10)
    parser.add_argument("--motions", nargs="+", default=list(MOTIONS), choices=list(MOTIONS))
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES), choices=list(STRATEGIES))
    parser.add_argument("--error", type=float, nargs="+", default=[0.3])
    asked = parser.parse_args()
    cases = itertools.product(asked.motions, asked.error, asked.strategies)
    write("fit_strategies", [show(row(m, s, e, asked.records)) for m, e, s in cases])


if __name__ == "__main__":
    main()
