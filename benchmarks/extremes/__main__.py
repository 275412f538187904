"""Every case in turn, each in a process of its own, and the largest error of each in one table.

    python -m benchmarks.extremes
"""

import csv
import subprocess
import sys

from .report import FOLDER

CASES = (
    "near_grazing", "zeno", "long_chains", "many_periods", "chaos", "stiffness", "mass_ratios", "units", "coincidences",
    "single_precision", "small_gaps", "random_scenes", "outside_code",
)  # fmt: skip


def largest(case: str) -> dict[tuple[str, str], float]:
    """Largest error of each kind of row among motions that ended successfully."""
    worst: dict[tuple[str, str], float] = {}
    with open(FOLDER / f"{case}.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["error"] and not row["ends"]:
                kind = row["case"], row["what"]
                worst[kind] = max(worst.get(kind, 0.0), float(row["error"]))
    return worst


def main() -> None:
    """Run the cases; a case that fails is named, and the others go on."""
    run = lambda case: subprocess.run([sys.executable, "-m", f"benchmarks.extremes.{case}"]).returncode
    failed = [case for case in CASES if run(case)]
    print(f"\n{'case':24} {'largest error where the motion ended successfully':52}")
    for case in CASES:
        if case not in failed:
            for (name, what), error in largest(case).items():
                print(f"{name:28} {what:52} {error:9.1e}")
    if failed:
        raise SystemExit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
