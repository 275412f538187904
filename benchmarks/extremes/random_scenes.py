"""Scenes at random: does every motion obey the laws, and do all ways to its gradient agree?

    python -m benchmarks.extremes.random_scenes --scenes 500

Differences are compared where the sequence of events stays the same under the differencing. A motion may end without
success only where impacts rightly do not end (a perfectly elastic contact pressed together) or where their cascade is
longer than the room for events.
"""

import argparse
import collections

import numpy as np

import hybridsens as hs

from .report import Row, main_of


def study(scenes: int, every: int = 5) -> list[Row]:
    """Laws of `scenes` motions, derivatives of every fifth."""
    from tests.problems import scenes_at_random as at_random
    from tests.problems.laws import violations

    worst: dict[str, float] = collections.defaultdict(float)
    ends: collections.Counter[str] = collections.Counter()
    compared = collections.Counter()
    rng = np.random.default_rng(0)
    for seed in range(scenes):
        given = at_random.draw(seed)
        motion = at_random.move(*given)
        ends[ending(given, motion)] += 1
        for law, size in violations(given, motion).items():
            worst[law] = max(worst[law], size)
        if seed % every == 0 and motion.status == hs.Status.successful:
            for name, error in _derivatives(at_random, given, rng).items():
                compared[name] += 1
                worst[name] = max(worst[name], error)
    rows = [Row("random scenes", name, count, None, "") for name, count in ends.items()]
    return rows + [Row("random scenes", name, compared.get(name, scenes), error, "") for name, error in worst.items()]


def ending(given, motion) -> str:
    """How a motion ended, in words."""
    if motion.status == hs.Status.successful:
        return "successful"
    if motion.status == hs.Status.grazing:
        return "grazing"
    if motion.status == hs.Status.max_events_reached:
        return "endless: elastic" if given.elastic else "more events than room"
    return hs.Status[motion.status].split(".")[0]


def _derivatives(at_random, given, rng) -> dict[str, float]:
    direction = at_random.random_direction(given, rng)
    forward, reverse = at_random.slopes(given, direction)
    found = {"forward against reverse": _relative(forward, reverse)}
    direction = at_random.load_alone(given, direction)
    forward, _ = at_random.slopes(given, direction)
    difference = at_random.difference_slope(given, direction, 1e-5)
    if difference is not None:
        found["forward against differences"] = _relative(forward, difference)
    return found


def _relative(a, b) -> float:
    return float(abs(a - b) / (1 + abs(b)))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=500)
    main_of("random_scenes", lambda arguments: study(arguments.scenes), parser)


if __name__ == "__main__":
    main()
