"""Value and gradient converge at the solver's order: explicit, explicit of high order, and implicit."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.scenes import ElasticStop
from tests.closeness import worst
from tests.problems import shipped_motions as motions
from tests.problems.reference_scenes import elastic_stop
from tests.problems.references import RECORDS

RECORD = RECORDS["P2b"]
# Solver, its order, and the tolerances between its first regular steps and the rounding of the sums.
SOLVERS = {
    "Tsit5": (diffrax.Tsit5(), 5, np.logspace(-6, -11, 6)),
    "Dopri8": (diffrax.Dopri8(), 8, np.logspace(-6, -11, 6)),
    # Coarser than this its errors are smaller than its order says: the stages are solved to more than was asked.
    "Kvaerno5": (diffrax.Kvaerno5(), 5, np.logspace(-6.5, -9, 6)),
}


def errors(solver, tolerances):
    """Numbers of steps, and relative errors of J and of its gradient."""

    def cost(p, tolerance):
        x = motions.inputs(elastic_stop(*p), RECORD["T"])
        trajectory = motions.run(ElasticStop, x, tolerance, solver=solver)
        return trajectory.cost, trajectory

    compiled = jax.jit(jax.value_and_grad(cost, has_aux=True))
    rows = []
    for tolerance in tolerances:
        (value, trajectory), gradient = compiled(jnp.array(RECORD["p"]), jnp.asarray(tolerance))
        assert trajectory.status == hs.Status.successful, f"{tolerance}: {hs.Status[trajectory.status]}"
        found = worst(value, float(RECORD["J"][0])), worst(gradient, np.array(RECORD["dJ"][0], float))
        rows.append((int(trajectory.steps.accepted), *found))
    return np.array(rows).T


@pytest.mark.parametrize(
    "name", ["Tsit5", *(pytest.param(name, marks=pytest.mark.slow) for name in ("Dopri8", "Kvaerno5"))]
)
def test_errors_fall_at_the_order_of_the_solver(name):
    """Slopes of the errors over the number of steps; a landing that is less exact than the solver would show here."""
    solver, order, tolerances = SOLVERS[name]
    steps, value, gradient = errors(solver, tolerances)
    for error in (value, gradient):
        slope = np.polyfit(np.log(steps), np.log(error), 1)[0]
        # Event times fall differently into the steps at each tolerance, so that errors scatter about their line.
        assert -order - 2 < slope < -order + 1.5, (slope, steps, error)
        assert error[-1] < 1e-2 * error[0]
