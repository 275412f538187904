"""Does a fit recover the truth, and do its intervals cover it? The elastic stop's six parameters from 100 noisy
records.

Each record has 200 samples of the position over 5 impacts, by SciPy, with noise of 1 % of the amplitude. Each guess is
off by up to 30 % in every parameter (`--guess corner`: by exactly 30 %, with random signs).

Run: python -m benchmarks.fit_recovery --records 100 --strategy growing
"""

import argparse
import csv
import time
from pathlib import Path
from typing import NamedTuple

import hybridsens as hs

hs.configure()

import numpy as np  # noqa: E402

from benchmarks.fit_motions import MOTIONS, guess, record  # noqa: E402
from benchmarks.machine import describe  # noqa: E402
from hybridsens.estimation import GrowingHorizon, fit  # noqa: E402

RESULTS = Path(__file__).parents[1] / "results" / "fit_recovery.csv"


class Outcome(NamedTuple):
    """One fit."""

    recovered: bool
    """Every parameter within 3 standard errors of the truth, and residuals no larger than the noise explains."""
    covered: np.ndarray
    """Which 95 % intervals contain the truth."""
    iterations: int
    """Trial points of all stages together."""
    final_iterations: int
    """Those of the last stage, on the full horizon."""
    seconds: float


MOTION = MOTIONS["short"]


def one_fit(seed: int, kind: str, error: float, settings: dict) -> Outcome:
    """Fit one record."""
    data, scene = record(MOTION, seed), guess(MOTION, seed, error, kind)
    begin = time.perf_counter()
    result = fit(scene, data, parameters=MOTION.fitted, bounds=MOTION.bounds, **settings)
    seconds = time.perf_counter() - begin
    truth = MOTION.values
    low, high = np.array(list(result.intervals().values())).T
    near = np.all(np.abs(result.values - truth) <= 3 * result.uncertainty.standard_errors)
    final = sum(line.stage == "full" and line.number > 0 for line in result.history)
    recovered = bool(near) and result.uncertainty.noise < 1.3
    return Outcome(recovered, (low <= truth) & (truth <= high), result.iterations, final, seconds)


def table(outcomes: list[Outcome]) -> dict[str, float]:
    """Shares and counts; coverage over all records, iterations and seconds over the recovered ones."""
    good = [o for o in outcomes if o.recovered]
    row = {"records": len(outcomes), "recovered": len(good)}
    cover = np.mean([o.covered for o in outcomes], axis=0)
    row |= {f"covered {name} [%]": 100 * share for name, share in zip(MOTION.fitted, cover, strict=True)}
    for what in ("iterations", "final_iterations", "seconds"):
        values = [getattr(o, what) for o in good[what == "seconds" :]] or [np.nan]  # the first one compiles
        row |= {f"{what}, median": float(np.median(values)), f"{what}, largest": float(np.max(values))}
    row["recovered within 15 iterations"] = sum(o.iterations <= 15 for o in good)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="Number of the first record.")
    parser.add_argument("--guess", choices=["uniform", "corner"], default="uniform")
    parser.add_argument("--error", type=float, default=0.3)
    parser.add_argument("--strategy", choices=["none", "growing"], nargs="+", default=["growing"])
    parser.add_argument("--starts", type=int, default=1)
    parser.add_argument("--optimizer", default="levenberg-marquardt")
    asked = parser.parse_args()
    strategies = {"none": None, "growing": GrowingHorizon()}
    rows = []
    for name in asked.strategy:
        settings = {"strategy": strategies[name], "starts": asked.starts, "optimizer": asked.optimizer}
        seeds = range(asked.first, asked.first + asked.records)
        outcomes = [one_fit(seed, asked.guess, asked.error, settings) for seed in seeds]
        rows.append({"strategy": name, "first record": asked.first, "guess": f"{asked.guess} {asked.error:g}",
                     "starts": asked.starts, "optimizer": asked.optimizer, **table(outcomes)})  # fmt: skip
        print(*(f"{key}: {value:.3g}" if isinstance(value, float) else f"{key}: {value}"
                for key, value in rows[-1].items()), sep="\n", end="\n\n", flush=True)  # fmt: skip
    _write(rows)


def _write(rows: list[dict]) -> None:
    """Rows of a run beside the machine; those of earlier runs with other settings stay."""
    rows = [{**row, **describe()} for row in rows]
    key = lambda row: tuple(str(row[name]) for name in ("strategy", "first record", "guess", "starts", "optimizer"))
    kept = list(csv.DictReader(RESULTS.open())) if RESULTS.exists() else []
    kept = [{"first record": 0, **row} for row in kept]
    rows = [row for row in kept if key(row) not in set(map(key, rows))] + rows
    RESULTS.parent.mkdir(exist_ok=True)
    with RESULTS.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[-1]))
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
