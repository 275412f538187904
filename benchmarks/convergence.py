"""Do the errors of J and of its gradient fall together, at the solver's order?

    python -m benchmarks.convergence              # P2 with Tsit5, Dopri8 and Kvaerno5; docs/convergence.png

Steps taken stand for the step size: a method of order p has an error that falls like steps^-p.
"""

import argparse
import json
from pathlib import Path

import diffrax
import numpy as np

import hybridsens as hs
from tests.problems import references

from .machine import describe
from .peers import reference

SOLVERS = {"Tsit5": (diffrax.Tsit5, 5), "Dopri8": (diffrax.Dopri8, 8), "Kvaerno5": (diffrax.Kvaerno5, 5)}
TOLERANCES = [10.0**-k for k in range(4, 12)]


def errors(solver, tolerances):
    """Rows (steps, error of J, error of the gradient), one compiled function for every tolerance."""
    import jax
    import jax.numpy as jnp

    from tests.problems.reference_scenes import elastic_stop, squared

    known = references.load("P2")
    p = jnp.asarray(known.parameters)

    def cost(p, tolerance):
        scene = elastic_stop(*p)
        motion = hs.simulate(
            scene, scene.initial_state(), t1=20.0, running_cost=squared, solver=solver, rtol=tolerance, atol=tolerance,
            max_events=16, max_steps=20_000, throw=False,
        )  # fmt: skip
        return motion.cost, motion.steps.accepted

    both = jax.jit(jax.value_and_grad(cost, has_aux=True))
    rows = []
    for tolerance in tolerances:
        (value, steps), gradient = both(p, jnp.asarray(tolerance))
        found = reference.errors("P2", float(value), np.asarray(gradient))
        rows.append((int(steps), found.value, found.gradient))
    return np.array(rows)


def plot(curves, path: Path) -> None:
    """Errors over steps, with the slope that each order asks for."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    for (name, (rows, order)), marker in zip(curves.items(), "osD", strict=True):
        axes.loglog(rows[:, 0], rows[:, 1], marker + "-", color="0.0", label=f"{name}: J")
        axes.loglog(rows[:, 0], rows[:, 2], marker + "--", color="0.5", mfc="white", label=f"{name}: gradient")
        guide = rows[0, 2] * 3 * (rows[:, 0] / rows[0, 0]) ** -float(order)
        axes.loglog(rows[:, 0], np.maximum(guide, 1e-13), ":", color="0.7", lw=1)
    axes.set(xlabel="steps", ylabel="relative error", title="elastic stop, five impacts (dotted: order 5, 8, 5)")
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=120)


def main() -> None:
    """Print the rows, draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs/convergence.png"))
    output = parser.parse_args().output
    hs.configure()
    print(json.dumps(describe()))
    curves = {}
    for name, (solver, order) in SOLVERS.items():
        rows = errors(solver(), TOLERANCES)
        curves[name] = rows, order
        for tolerance, (steps, value, gradient) in zip(TOLERANCES, rows, strict=True):
            print(f"{name:9} {tolerance:7.0e} {steps:6.0f} steps  J {value:.1e}  gradient {gradient:.1e}", flush=True)
    plot(curves, output)
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
