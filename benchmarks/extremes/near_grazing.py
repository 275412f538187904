"""Impacts ever closer to grazing: the gradient's relative error against tolerance / speed, and who says so beyond.

python -m benchmarks.extremes.near_grazing
"""

import argparse

import numpy as np

from tests.problems import one_contact as one

from .report import Row, main_of, status_name

SPEEDS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 0.0)
TOLERANCE = 1e-10


def study() -> list[Row]:
    """q'' = -q with a stop at 1 that it meets at each speed; closed form."""
    rows = []
    for speed in SPEEDS:
        v = np.sqrt(1 + speed**2)
        value, (by_scene, _, by_v), motion = one.go(one.make(0, 1, -1, 1, 0.7), 0.0, v, 3.0, tolerance=TOLERANCE)
        ends = status_name(motion)
        rows.append(Row("near grazing", "value, against speed", speed, _value_error(value, v), ends))
        if speed > 0:
            found = [by_v, by_scene.offset[0], by_scene.e[0]]
            error = one.relative(found, one.oscillator_slopes(v, 1.0, 0.7, 3.0))
            rows.append(Row("near grazing", "gradient x speed / tolerance", speed, error * speed / TOLERANCE, ends))
        finite = all(np.all(np.isfinite(leaf)) for leaf in (value, by_v, by_scene.offset, by_scene.e))
        assert finite, "nothing may be NaN"
    return rows


def _value_error(value, v) -> float:
    return abs(float(value / one.oscillator_cost(v, 1.0, 0.7, 3.0)) - 1)


if __name__ == "__main__":
    main_of("near_grazing", lambda _: study(), argparse.ArgumentParser(description=__doc__))
