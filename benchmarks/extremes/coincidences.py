"""Events at the start, the end and data times, two at one instant, a clock far from zero, many periods.

python -m benchmarks.extremes.coincidences
"""

import argparse

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import hybridsens as hs
from tests.problems import one_contact as one
from tests.problems.flat_contacts import make, run

from .report import Row, main_of, status_name

GRAVITY = 9.81
SHIFTS = (-1e-9, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-9)


def at_the_start() -> list[Row]:
    """A body that starts on the floor, or within rounding of it, and moves into it: v+ = -e v- - g t."""
    rows = []
    for gap in (0.0, 1e-17, 1e-14, 1e-12, 1e-9):
        _, _, motion = one.go(one.make(-GRAVITY), gap, -1.0, 0.05)
        wait = 2 * gap / (1 + np.sqrt(1 + 2 * GRAVITY * gap))
        error = abs(float(motion.final.v[0]) - (0.5 * (1 + GRAVITY * wait) - GRAVITY * (0.05 - wait)))
        error = error if int(motion.events.count) == 1 else np.inf
        rows.append(Row("impact near the start", "velocity after, gap at the start", gap, error, status_name(motion)))
    return rows


def at_the_end() -> list[Row]:
    """The horizon ends just before or after the impact: the velocity is that of one side, the place is the floor."""
    rows, fall = [], np.sqrt(2 / GRAVITY)
    for shift in SHIFTS:
        _, _, motion = one.go(one.make(-GRAVITY), 1.0, 0.0, fall + shift)
        sides = np.array([-1.0, 0.5]) * GRAVITY * fall - GRAVITY * shift
        error = np.min(np.abs(float(motion.final.v[0]) - sides)) / (GRAVITY * fall)
        rows.append(Row("impact near the end", "velocity of one side, shift", shift, error, status_name(motion)))
    return rows


@eqx.filter_jit
def _sampled(ts):
    state = hs.State(jnp.ones(1), jnp.zeros(1))
    return hs.simulate(one.make(-GRAVITY), state, t1=0.6, ts=ts, throw=False)


def at_data_times() -> list[Row]:
    """Data times around an impact, and 10,000 of them where the motion takes a dozen steps: exact parabolas."""
    fall, rows = np.sqrt(2 / GRAVITY), []

    def exact(ts):
        s = ts - fall
        return np.where(s < 0, 1 - GRAVITY * ts**2 / 2, 0.5 * GRAVITY * fall * s - GRAVITY * s**2 / 2)

    around = fall + np.array(SHIFTS)
    for name, ts in (("around an impact", around), ("denser than steps", np.linspace(0, 0.6, 10_000))):
        motion = _sampled(jnp.array(ts))
        error = float(np.max(np.abs(motion.q[:, 0] - exact(ts))))
        rows.append(Row("data times", name, len(ts), error, status_name(motion)))
    return rows


def in_a_corner() -> list[Row]:
    """A point flies into a square corner and meets both walls at one instant, or one a little later: v+ = -v-."""
    rows = []
    for shift in (0.0, 1e-15, 1e-12, 1e-9):
        corner = make([1.0, 1.0], [0.0, 0.0], np.eye(2), [0.0, 0.0], [1.0, 1.0])
        motion = run(corner, [1.0, 1.0 + shift], [-1.0, -1.0], 1.5)
        error = float(np.max(np.abs(motion.final.v - 1.0)))
        rows.append(Row("two impacts in a corner", "velocity after, time apart", shift, error, status_name(motion)))
    return rows


def horizons() -> list[Row]:
    """A clock far from zero, a horizon of 1e-12, and 1,000 periods of an oscillator that never meets its stop."""
    rows = []
    for start in (1e3, 1e6, 1e9):
        _, _, motion = one.go(one.make(-GRAVITY), 1.0, 0.0, start + 3.0, start)
        error = abs(float(motion.final.q[0]))
        rows.append(Row("late clock", "at rest on the floor, start", start, error, status_name(motion)))
    _, _, motion = one.go(one.make(-GRAVITY), 1.0, 0.0, 1e-12)
    rows.append(Row("horizon", "place after", 1e-12, abs(float(motion.final.q[0]) - 1.0), status_name(motion)))
    t1 = 2e3 * np.pi
    _, _, motion = one.go(one.make(0, 1, -1, 2), 1.0, 0.0, t1, max_events=2**16)
    error = abs(float(motion.final.q[0]) - 1.0)
    rows.append(Row("horizon", "place after 1,000 periods", t1, error, status_name(motion)))
    return rows


def study() -> list[Row]:
    """All of them."""
    return at_the_start() + at_the_end() + at_data_times() + in_a_corner() + horizons()


if __name__ == "__main__":
    main_of("coincidences", lambda _: study(), argparse.ArgumentParser(description=__doc__))
