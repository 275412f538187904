"""float32 throughout: what accuracy value and gradient reach, and that no impact is missed.

python -m benchmarks.extremes.single_precision
"""

import argparse
import warnings

import jax.numpy as jnp
import numpy as np

from tests.problems import one_contact as one

from .report import Row, main_of, status_name


def study() -> list[Row]:
    """A ball that bounces to rest and the oscillator with a stop; default tolerances are raised to 16 eps = 1.9e-6."""
    rows = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the word that the tolerances were raised
        for e in (0.01, 0.1, 0.5, 0.8, 0.9):
            value, (by_scene, _, _), motion = one.go(one.make(-9.81, e=e, dtype=jnp.float32), 1.0, 0.0, 12.0)
            ends = status_name(motion)
            error = one.relative(value, one.bouncing_cost(1.0, 9.81, e))
            slope = one.relative(by_scene.e[0], one.bouncing_slopes(1.0, 9.81, e)[2])
            rows.append(Row("float32", "ball to rest: value, e", e, error, ends))
            rows.append(Row("float32", "ball to rest: gradient, e", e, slope, ends))
        for speed in (1.0, 0.1, 0.01):
            v = np.sqrt(1 + speed**2)
            value, (by_scene, _, by_v), motion = one.go(one.make(0, 1, -1, 1, 0.7, dtype=jnp.float32), 0.0, v, 3.0)
            found = [by_v, by_scene.offset[0], by_scene.e[0]]
            ends = status_name(motion)
            error = one.relative(value, one.oscillator_cost(v, 1.0, 0.7, 3.0))
            slope = one.relative(found, one.oscillator_slopes(v, 1.0, 0.7, 3.0))
            rows.append(Row("float32", "stop: value, speed of the impact", speed, error, ends))
            rows.append(Row("float32", "stop: gradient, speed of the impact", speed, slope, ends))
    return rows


if __name__ == "__main__":
    main_of("single_precision", lambda _: study(), argparse.ArgumentParser(description=__doc__))
