"""Does a fit recover the truth, and do its intervals cover it? The elastic stop's six parameters from 100 noisy
records.

Each record has 200 samples of the position over 5 impacts, with noise of 1 % of the amplitude. Each guess is off by up
to 30 % in every parameter (`--guess corner`: by exactly 30 %, with random signs).

Run: python benchmarks/fit_recovery.py --records 100 --strategy growing
"""

import argparse
import time
from typing import NamedTuple

import hybridsens as hs

hs.configure()

import numpy as np  # noqa: E402

from hybridsens.scenes import ElasticStop  # noqa: E402
from hybridsens.study.fit import GrowingHorizon, MultipleShooting, fit, measurements  # noqa: E402

TRUTH = {
    "stiffness": 1.0, "damping": 0.1, "amplitude": 1.0, "frequency": 1.3, "distance": 0.6, "restitution_coefficient":
    0.8,
}  # fmt: skip
BOUNDS = {name: "positive" for name in TRUTH} | {"restitution_coefficient": (0, 1)}
TIMES = np.linspace(0.1, 20.0, 200)


class Outcome(NamedTuple):
    """One fit."""

    recovered: bool
    """Every parameter within 3 standard errors of the truth."""
    covered: np.ndarray
    """Which 95 % intervals contain the truth."""
    iterations: int
    """All stages together."""
    final_iterations: int
    """Those of the last stage, on the full horizon."""
    seconds: float


def record(seed: int):
    """A noisy record of the true motion."""
    truth = ElasticStop(**TRUTH)
    motion = hs.simulate(truth, truth.initial_state(), t1=20.0, ts=TIMES)
    q = np.asarray(motion.q)[:, 0]
    sigma = 0.01 * np.max(np.abs(q))
    return measurements(TIMES, q + sigma * np.random.default_rng(seed).normal(size=q.size), sigma=sigma)


def guess(seed: int, kind: str, error: float) -> ElasticStop:
    """Parameters off by up to `error`, or by exactly `error`."""
    random = np.random.default_rng(1_000_000 + seed)
    off = error * (random.uniform(-1, 1, 6) if kind == "uniform" else random.choice([-1, 1], 6))
    values = np.array(list(TRUTH.values())) * (1 + off)
    values[5] = min(values[5], 0.98)
    return ElasticStop(**dict(zip(TRUTH, values, strict=True)))


def one_fit(seed: int, kind: str, error: float, settings: dict) -> Outcome:
    """Fit one record."""
    data, scene = record(seed), guess(seed, kind, error)
    begin = time.perf_counter()
    result = fit(scene, data, parameters=list(TRUTH), bounds=BOUNDS, **settings)
    seconds = time.perf_counter() - begin
    errors = np.abs(result.values - list(TRUTH.values()))
    low, high = np.array(list(result.intervals().values())).T
    covered = (low <= list(TRUTH.values())) & (list(TRUTH.values()) <= high)
    recovered = bool(np.all(errors <= 3 * result.uncertainty.standard_errors)) and result.uncertainty.noise < 1.3
    final = sum(line.stage == "full" and line.number > 0 for line in result.history)
    return Outcome(recovered, covered, result.iterations, final, seconds)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--guess", choices=["uniform", "corner"], default="uniform")
    parser.add_argument("--error", type=float, default=0.3)
    parser.add_argument("--strategy", choices=["none", "growing", "shooting"], default="growing")
    parser.add_argument("--starts", type=int, default=1)
    parser.add_argument("--optimizer", default="levenberg-marquardt")
    asked = parser.parse_args()
    strategy = {"none": None, "growing": GrowingHorizon(), "shooting": MultipleShooting()}[asked.strategy]
    settings = {"strategy": strategy, "starts": asked.starts, "optimizer": asked.optimizer}
    outcomes = [one_fit(seed, asked.guess, asked.error, settings) for seed in range(asked.records)]
    good = [o for o in outcomes if o.recovered]
    print(f"recovered within 3 standard errors: {len(good)} of {len(outcomes)}")
    if not good:
        return
    found = [o for o in outcomes if o.final_iterations and o.recovered]
    cover = np.mean([o.covered for o in outcomes], axis=0)
    for name, share in zip(TRUTH, cover, strict=True):
        print(f"  95 % interval of {name} covers the truth in {100 * share:.0f} of 100")
    for what in ("iterations", "final_iterations", "seconds"):
        values = [getattr(o, what) for o in found]
        print(f"{what}: median {np.median(values):.3g}, largest {np.max(values):.3g}")


if __name__ == "__main__":
    main()
