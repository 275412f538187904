"""Masses far apart, redundant feet, impacts at one instant: against the textbook and the law of simultaneous impacts.

python -m benchmarks.extremes.mass_ratios
"""

import argparse

import numpy as np

from tests.problems.flat_contacts import TABLES, balls, make, plate, run

from .report import Row, main_of, status_name

RATIOS = (1e-8, 1e-4, 1.0, 1e4, 1e8)


def collisions() -> list[Row]:
    """Two bodies of every mass ratio, e = 0.7; then the billiard whose collisions count the digits of pi."""
    rows = []
    for ratio in RATIOS:
        motion = run(balls(2, 0.7, [1.0, ratio]), [0.0, 2.0], [1.0, 0.0], 2.0)
        expected = 1 / (1 + ratio) + 0.7 / (1 + ratio) * np.array([-ratio, 1.0])
        error = float(np.max(np.abs(motion.final.v - expected)))
        rows.append(Row("mass ratios", "velocities after", ratio, error, status_name(motion)))
    for ratio, count in ((1e2, 31), (1e4, 314), (1e6, 3141)):
        scene = make([1.0, ratio], [0.0, 0.0], [[1.0, 0.0], [-1.0, 1.0]], [0.0, 0.0], [1.0, 1.0])
        motion = run(scene, [1.0, 2.0], [0.0, -1.0], 10.0)
        energy = float(motion.final.v**2 @ scene.mass / ratio)
        wrong = abs(int(motion.events.count) - count)
        rows.append(Row("mass ratios", "collisions missed or made up (pi)", ratio, wrong))
        rows.append(Row("mass ratios", "energy after them (pi)", ratio, abs(energy - 1), status_name(motion)))
    return rows


def cradle() -> list[Row]:
    """Five balls: touching (all four contacts at once) and a billionth apart (one after the other)."""
    rows = []
    for e in (1.0, 0.5):
        motion = run(balls(5, e), [-0.5, 1.0, 2.0, 3.0, 4.0], [1.0, 0.0, 0.0, 0.0, 0.0], 3.0)
        expected = np.array([(1 + e) / 5 - e, *[(1 + e) / 5] * 4])
        error = _worst(motion.final.v - expected)
        rows.append(Row("cradle, touching", "velocities after, e", e, error, status_name(motion)))
    places = [-0.5, *(1 + 1e-9) * np.arange(4) + 1]
    motion = run(balls(5, 1.0), places, [1.0, 0.0, 0.0, 0.0, 0.0], 3.0)
    error = _worst(motion.final.v - np.array([0.0, 0.0, 0.0, 0.0, 1.0]))
    return [*rows, Row("cradle, 1e-9 apart", "velocities after, e", 1.0, error, status_name(motion))]


def tables() -> list[Row]:
    """A plate dropped flat on redundant feet rests flat; dropped tilted it rests, with no energy gained."""
    rows = []
    for table, feet in TABLES.items():
        for e in (0.0, 0.5):
            scene = plate(feet, e)
            flat = run(scene, [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], 2.0)
            tilted = run(scene, [1.0, 0.1, 0.07], [0.0, 0.0, 0.0], 6.0)
            for name, motion in (("flat", flat), ("tilted", tilted)):
                error = max(_worst(motion.final.q), _worst(motion.final.v))
                rows.append(Row(f"plate, {table}", f"dropped {name}, at rest, e", e, error, status_name(motion)))
    return rows


def _worst(values) -> float:
    return float(np.max(np.abs(np.asarray(values))))


def study() -> list[Row]:
    """All of them."""
    return collisions() + cradle() + tables()


if __name__ == "__main__":
    main_of("mass_ratios", lambda _: study(), argparse.ArgumentParser(description=__doc__))
