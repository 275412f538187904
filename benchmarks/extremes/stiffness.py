"""A stiff support beside a hard stop: frequency ratios 1e2 to 1e6, implicit and explicit solvers.

python -m benchmarks.extremes.stiffness
"""

import argparse

import diffrax
import jax.numpy as jnp
import numpy as np

from tests.problems.stiff_support import reference, solve

from .report import Row, main_of, status_name

RATIOS = (1e2, 1e4, 1e6)


def study() -> list[Row]:
    """Kvaerno5 and Tsit5 at each ratio and tolerance. A force of size ratio^2 q has a rounding of ratio^2 eps, and no
    tolerance can be met below it: 1e-8 at ratio 1e6 ends with a status."""
    rows = []
    for ratio in RATIOS:
        value, gradient = reference(ratio)
        for name, solver in (("Kvaerno5", diffrax.Kvaerno5()), ("Tsit5", diffrax.Tsit5())):
            for tolerance in (1e-6, 1e-8):
                (found, motion), slope = solve(solver, jnp.array(ratio), jnp.array(tolerance))
                ends = status_name(motion)
                errors = abs(float(found) - value), float(np.max(np.abs(slope - gradient)) / np.max(np.abs(gradient)))
                for what, error in zip(("value", "gradient"), errors, strict=True):
                    title = f"{name}, tolerance {tolerance:.0e}: {what}"
                    rows.append(Row("stiffness", title, ratio, None if ends else error, ends))
    return rows


if __name__ == "__main__":
    main_of("stiffness", lambda _: study(), argparse.ArgumentParser(description=__doc__))
