"""A chaotic impact oscillator: the gradient against 60-digit arithmetic while it grows to 1e8 and beyond.

python -m benchmarks.extremes.chaos
"""

import argparse

import jax.numpy as jnp
import numpy as np

from tests.problems.impact_oscillator import grow, reference

from .report import Row, main_of, status_name

HORIZONS = (20.0, 40.0, 80.0, 120.0, 160.0, 200.0)
TOLERANCES = (1e-8, 1e-10, 1e-12)


def study(horizons=HORIZONS, tolerances=TOLERANCES) -> list[Row]:
    """The growth of variations, and the largest relative error of its matrix at each tolerance."""
    rows = []
    for t1 in horizons:
        state, matrix, impacts = reference(0.5, t1)
        growth = np.linalg.norm(matrix, 2)
        rows.append(Row("chaos", f"growth after {impacts} impacts", t1, growth))
        for tolerance in tolerances:
            found = grow(jnp.array(0.5), jnp.array(t1), jnp.array(tolerance))
            ends = status_name(found.trajectory)
            error = np.max(np.abs(found.matrix - matrix)) / growth
            rows.append(Row("chaos", f"gradient at tolerance {tolerance:.0e}", t1, error, ends))
        exponent = np.log(growth) / t1
        rows.append(Row("chaos", "Lyapunov exponent", t1, abs(float(found.exponent) / exponent - 1), ends))
    return rows


if __name__ == "__main__":
    main_of("chaos", lambda _: study(), argparse.ArgumentParser(description=__doc__))
