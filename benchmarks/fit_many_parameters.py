"""What a fit costs with more parameters: an oscillator with a stop, driven by a Fourier series.

    q'' = -k q - c q' + sum_j a_j cos(j w t) + b_j sin(j w t),   q <= d,   j = 1 ... harmonics

k, c, d, the restitution and all a_j, b_j are unknown: 4 + 2 harmonics parameters from 400 positions by SciPy with noise
of 1 %, guesses off by up to 5 %. The same Levenberg-Marquardt on forward sensitivities and on differences of the same
motion; L-BFGS on the adjoint's gradient; SciPy's `least_squares`. A fit succeeds if its residuals are noise: their
spread is less than 1.2 sigma. Seconds are those of compiled fits, the best of three runs each.

Run: python -m benchmarks.fit_many_parameters --harmonics 1 4 10
"""

import argparse
import itertools
from collections.abc import Callable

import hybridsens as hs

hs.configure()

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from jaxtyping import Array, Float  # noqa: E402

from benchmarks.fit_against_naive import Found, differences, ours, scipys, timed  # noqa: E402
from benchmarks.fit_motions import SLOWLY  # noqa: E402
from benchmarks.rows import show, write  # noqa: E402
from hybridsens.adjoint.methods import Replay  # noqa: E402
from hybridsens.estimation import measurements, prepare  # noqa: E402
from hybridsens.estimation.descend import (  # noqa: E402
    Callbacks,  # noqa: E402
    Limits,
    descend,
)
from hybridsens.estimation.iterate import BatchSize  # noqa: E402
from hybridsens.estimation.optimizers import chosen_method  # noqa: E402
from hybridsens.estimation.problem import Problem  # noqa: E402
from hybridsens.scenes import ElasticStop  # noqa: E402
from tests.problems.stop_record import TRUTH, positions  # noqa: E402

TIMES = np.linspace(0.05, 20.0, 400)
BASE = 0.45
"""w [rad/s]."""
FITTED = ["stiffness", "damping", "distance", "restitution_coefficient", "series"]
BOUNDS = {"stiffness": "positive", "damping": "positive", "distance": "positive", "restitution_coefficient": (0, 1)}


class SeriesStop(ElasticStop):
    """The oscillator with a stop, driven by a Fourier series."""

    series: Float[Array, "harmonic 2"] = None  # type: ignore[assignment]
    """a_j, b_j [N]"""

    def force(self, t, q, v):
        phases = BASE * t * jnp.arange(1, self.series.shape[0] + 1)
        push = jnp.sum(self.series * jnp.stack([jnp.cos(phases), jnp.sin(phases)], axis=1))
        return -self.stiffness * q - self.damping * v + push


def true_series(harmonics: int) -> np.ndarray:
    """Coefficients of a drive with energy near the resonance."""
    series = np.random.default_rng(5).normal(size=(harmonics, 2))
    return series / np.linalg.norm(series)


def problem(harmonics: int, seed: int) -> Problem:
    """One noisy record and one guess."""
    series, random = true_series(harmonics), np.random.default_rng(seed)
    j = np.arange(1, harmonics + 1)
    q, _ = positions(TRUTH, TIMES, lambda t: float(np.sum(
        series * np.stack([np.cos(BASE * j * t), np.sin(BASE * j * t)], axis=1))))  # fmt: skip
    sigma = 0.01 * np.max(np.abs(q))
    off = lambda value: value * (1 + 0.05 * random.uniform(-1, 1, np.shape(value)))
    scene = SeriesStop(**{name: jnp.asarray(off(TRUTH[name])) for name in FITTED[:-1]}, series=jnp.asarray(off(series)))
    data = measurements(TIMES, q + sigma * random.normal(size=q.size), sigma=sigma)
    return prepare.build_problem(scene, data, prepare.Unknowns(FITTED, BOUNDS))


def by_gradients(problem: Problem) -> Found:
    """L-BFGS on the adjoint's gradient."""
    z = problem.selection.from_values(problem.selection.values(problem.scene))
    done = descend(chosen_method("lbfgs"), problem, z, Limits(200, 30), callbacks=Callbacks(batch_size=BatchSize()))
    return Found(np.asarray(problem.selection.to_values(done.z)), len(done.history) - 1)


METHODS: dict[str, Callable[[Problem], Found]] = {
    "Levenberg-Marquardt, sensitivities": lambda p: ours(p, None),
    "Levenberg-Marquardt, sensitivities, growing horizon": lambda p: ours(p, SLOWLY),
    "Levenberg-Marquardt, differences over 1e-4": lambda p: differences(p, None, "over 1e-4"),
    "Levenberg-Marquardt, differences over 1e-4, growing horizon": lambda p: differences(p, SLOWLY, "over 1e-4"),
    "Levenberg-Marquardt, differences over sqrt(eps)": lambda p: differences(p, None, "over sqrt(eps)"),
    "Levenberg-Marquardt, central differences over cbrt(eps)": lambda p: differences(
        p, None, "central, over cbrt(eps)"
    ),
    "L-BFGS, adjoint": by_gradients,
    "scipy least_squares, its default differences": lambda p: scipys(p, None),
}


def row(harmonics: int, name: str, records: int) -> dict:
    """One method on all records."""
    spreads, iterations, seconds = [], [], []
    for seed in range(-1, records):  # the first one compiles
        case = problem(harmonics, max(seed, 0))
        found, quickest = timed(METHODS[name], case)
        seconds.append(quickest)
        r, _ = case.residuals(case.selection.from_values(found.values), Replay())
        count = found.values.size
        spreads.append(float(np.sqrt(np.sum(np.asarray(r) ** 2) / (TIMES.size - count))))
        iterations.append(found.iterations)
    return {
        "parameters": 4 + 2 * harmonics, "method": name, "records": records,
        "recovered": int(np.sum(np.array(spreads[1:]) < 1.2)),
        "residual spread, median [sigma]": np.median(spreads[1:]),
        "iterations, median": np.median(iterations[1:]), "seconds, median": np.median(seconds[1:]),
        "seconds, total": sum(seconds[1:]),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=10)
    parser.add_argument("--harmonics", type=int, nargs="+", default=[1, 4, 10])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS))
    asked = parser.parse_args()
    cases = itertools.product(asked.harmonics, asked.methods)
    rows = [show(row(harmonics, name, asked.records)) for harmonics, name in cases]
    write("fit_many_parameters", rows)


if __name__ == "__main__":
    main()
