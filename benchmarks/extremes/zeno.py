"""Impacts that accumulate: restitution 0.01 to 0.99, on the flat and on an incline, against the limit of the series.

python -m benchmarks.extremes.zeno
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np

import hybridsens as hs
from tests.problems import one_contact as one

from .report import Row, main_of, status_name

GRAVITY = 9.81
RESTITUTIONS = (0.01, 0.1, 0.5, 0.8, 0.9, 0.95, 0.99)
CUTS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)


class Incline(hs.AbstractScene):
    """A point above a smooth incline of angle a: after the bounces it slides, x'' = g sin a along it."""

    angle: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -GRAVITY])

    def gap(self, t, q):
        return (jnp.sin(self.angle) * q[0] + jnp.cos(self.angle) * q[1])[None]

    def restitution(self):
        return self.e[None]


def study() -> list[Row]:
    """Flat: value and gradient. Incline: place of the sliding point and its slope by the angle. Cut: its order."""
    rows = []
    for e in RESTITUTIONS:
        rest = np.sqrt(2 / GRAVITY) * (1 + e) / (1 - e)
        value, (by_scene, by_q, _), motion = one.go(one.make(-GRAVITY, e=e), 1.0, 0.0, 1.5 * rest)
        found = [by_q, -by_scene.load[0], by_scene.e[0]]
        ends = status_name(motion)
        rows.append(Row("Zeno, flat", "value", e, one.relative(value, one.bouncing_cost(1.0, GRAVITY, e)), ends))
        rows.append(Row("Zeno, flat", "gradient", e, one.relative(found, one.bouncing_slopes(1.0, GRAVITY, e)), ends))
    rows += [row for e in RESTITUTIONS for row in _incline(e)]
    for cut in CUTS:
        _, (by_scene, _, _), _ = one.go(one.make(-GRAVITY, e=0.8), 1.0, 0.0, 6.0, capture_speed=cut)
        error = one.relative(by_scene.e[0], one.bouncing_slopes(1.0, GRAVITY, 0.8)[2])
        rows.append(Row("Zeno, flat", "gradient by e, against capture_speed", cut, error))
    return rows


@jax.jit
def _slide(angle, e, t1):
    def along(angle):
        scene = Incline(angle, e)
        state = hs.State(jnp.array([0.0, 1.0]), jnp.zeros(2))
        motion = hs.simulate(scene, state, t1=t1, rtol=1e-10, atol=1e-10, max_events=4096, max_steps=16384, throw=False)
        return motion.final.q, motion

    slope, motion = jax.jacrev(along, has_aux=True)(angle)
    return slope, motion


def _incline(e: float) -> list[Row]:
    """Nothing but gravity ever acts along the incline: from rest at (0, 1), s = sin(a) (g t^2 / 2 - 1) downhill.

    The slope is as exact as rounding lets it be: turned by an angle, a gap 12 km downhill moves by as much, and the
    last impacts have a speed of 3e-5 m/s.
    """
    angle, t1 = 0.3, 1.5 * np.sqrt(2 / GRAVITY) * (1 + e) / (1 - e)
    slope, motion = _slide(jnp.array(angle), jnp.array(e), jnp.array(t1))

    def place(a):
        return jnp.array([jnp.cos(a), -jnp.sin(a)]) * jnp.sin(a) * (GRAVITY * t1**2 / 2 - 1)

    pairs = {"place": (motion.final.q, place(angle)), "slope by the angle": (slope, jax.jacfwd(place)(angle))}
    off = lambda found, expected: float(jnp.max(jnp.abs(found - expected)) / jnp.max(jnp.abs(expected)))
    return [Row("Zeno, incline", what, e, off(*pair), status_name(motion)) for what, pair in pairs.items()]


if __name__ == "__main__":
    main_of("zeno", lambda _: study(), argparse.ArgumentParser(description=__doc__))
