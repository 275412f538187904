"""Fast small gaps: rattling in a clearance of 1e-9, a bead that hits a tip of radius 1e-6, a thin spike in a gap.

python -m benchmarks.extremes.small_gaps
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np

from tests.problems.small_gaps import CLEARANCE, fly, rattle, strike

from .report import Row, main_of, status_name

RADII = (1.0, 1e-2, 1e-4, 1e-6)
WIDTHS = (0.3, 0.1, 0.01, 1e-3, 1e-6, 1e-9)


def rattling() -> list[Row]:
    """A thousand impacts in one unit of time: q is a triangular wave in the distance travelled."""
    rows = []
    speed = 1000.25 * CLEARANCE
    for place in (0.0, 1.0):
        value, slope, motion = rattle(jnp.array(place), jnp.array(speed))
        travelled = CLEARANCE / 2 + speed
        crossings = int(travelled // CLEARANCE)
        expected = travelled - crossings * CLEARANCE
        expected, sign = (CLEARANCE - expected, -1.0) if crossings % 2 else (expected, 1.0)
        ends, wrong = status_name(motion), abs(int(motion.events.count) - crossings)
        error = abs(float(value) - expected) / CLEARANCE
        rows += [
            Row("rattling in 1e-9", "impacts missed or made up, walls at", place, wrong, ends),
            Row("rattling in 1e-9", "place, relative to the clearance", place, error, ends),
            Row("rattling in 1e-9", "slope by the speed", place, abs(float(slope) - sign), ends),
        ]
    return rows


def tips(offset=0.6) -> list[Row]:
    """Reflection at the normal (-cos a, sin a) with sin a = offset: v+ = (-cos 2a, sin 2a)."""
    rows = []
    expected = lambda b: jnp.stack([2 * b**2 - 1, 2 * b * jnp.sqrt(1 - b**2)])
    for radius in RADII:
        motion, slope = strike(jnp.array(radius / 2), jnp.array(offset))
        error = float(jnp.max(jnp.abs(motion.final.v - expected(offset))))
        error_slope = float(jnp.max(jnp.abs(slope - jax.jacfwd(expected)(offset))))
        rows.append(Row("tip of small radius", "velocity after", radius / 2, error, status_name(motion)))
        rows.append(Row("tip of small radius", "its slope by the offset", radius / 2, error_slope, status_name(motion)))
    return rows


def spikes() -> list[Row]:
    """The bead must turn back where the spike reaches down to it: at q = 0.6 - width sqrt(ln 2)."""
    rows = []
    for width in WIDTHS:
        turn = 0.6 - width * np.sqrt(np.log(2))
        motion = fly(jnp.array(width))
        error = abs(float(motion.final.q[0]) - (2 * turn - 1))
        ends = status_name(motion) if int(motion.events.count) else "stepped over"
        rows.append(Row("thin spike", "place at the end", width, error, ends))
    return rows


def study() -> list[Row]:
    """All three."""
    return rattling() + tips() + spikes()


if __name__ == "__main__":
    main_of("small_gaps", lambda _: study(), argparse.ArgumentParser(description=__doc__))
