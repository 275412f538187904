"""Is every ready-made scene's gradient right? `check_gradient` on each: three methods, and event by event.

    python -m benchmarks.check_scenes                       # a few minutes, nearly all of it compilation
    python -m benchmarks.check_scenes vibrating-table

Prints the report of each scene and a table at the end, which also goes to results/check_scenes.csv.
"""

import argparse
import csv
import json
import time
from pathlib import Path
from typing import NamedTuple

import hybridsens as hs

from .machine import describe


class Row(NamedTuple):
    """One scene."""

    scene: str
    ok: bool
    parameters: int
    events: int
    adjoint_and_forward: float
    """Largest distance between both gradients, relative to the largest entry."""
    adjoint_and_differences: float
    """The same for the differences."""
    seconds: float
    """Processor time."""


def check(name: str) -> Row:
    """Check one scene and print the report."""
    import numpy as np

    start = time.process_time()
    report = hs.check_gradient(hs.scenes.SCENES[name]())
    adjoint, forward, differences = (
        np.array([getattr(entry, method) for entry in report.parameters])
        for method in ("adjoint", "forward", "differences")
    )
    largest = np.max(np.abs(adjoint))
    apart = [float(np.max(np.abs(adjoint - other)) / largest) for other in (forward, differences)]
    print(f"\n{name}\n{report}", flush=True)
    return Row(name, report.ok, len(adjoint), len(report.events), *apart, time.process_time() - start)


def main() -> None:
    """Check the scenes that were asked for; the exit status tells whether all of them passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE")
    parser.add_argument("--csv", type=Path, default=Path("results/check_scenes.csv"))
    arguments = parser.parse_args()
    hs.configure()
    rows = [check(name) for name in arguments.scenes or hs.scenes.SCENES]
    print(f"\n{'scene':22}{'':8}{'parameters':>11}{'events':>8}{'forward':>10}{'differences':>13}{'seconds':>9}")
    for row in rows:
        word = "passed" if row.ok else "FAILED"
        print(
            f"{row.scene:22}{word:8}{row.parameters:>11}{row.events:>8}{row.adjoint_and_forward:>10.1e}"
            f"{row.adjoint_and_differences:>13.1e}{row.seconds:>9.0f}"
        )
    arguments.csv.parent.mkdir(exist_ok=True)
    with arguments.csv.open("w", newline="") as file:
        file.write(f"# {json.dumps(describe())}\n")
        csv.writer(file).writerows([Row._fields, *rows])
    raise SystemExit(not all(row.ok for row in rows))


if __name__ == "__main__":
    main()
