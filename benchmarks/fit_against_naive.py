"""The same fit with exact, naive and difference derivatives: iterations, time, success.

Noisy records by SciPy (see `fit_motions.py`): "short", the elastic stop's six parameters, from guesses up to 30 % off,
and "chaotic", four parameters of a motion that amplifies them 20 000-fold or more, from guesses up to 10 % off. All use
the same Levenberg-Marquardt, with and without the horizon strategy that suits the motion; and there is SciPy's own
`least_squares` on this package's motions. A fit succeeds if every parameter ends within 3 standard errors of the truth.
Seconds are those of compiled fits, the best of three runs each, failed fits included.

Run: python -m benchmarks.fit_against_naive --records 20
"""

import argparse
import functools
import itertools
import time
from collections.abc import Callable
from typing import NamedTuple

import hybridsens as hs

hs.configure()

import equinox as eqx  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402

from benchmarks.fit_motions import MOTIONS, Motion  # noqa: E402
from benchmarks.fit_motions import problem as problem_of  # noqa: E402
from benchmarks.fit_problems import DifferencesProblem, NaiveProblem, like  # noqa: E402
from benchmarks.rows import show, write  # noqa: E402
from hybridsens.adjoint.methods import Replay  # noqa: E402
from hybridsens.estimation import GrowingHorizon  # noqa: E402
from hybridsens.estimation.descend import Callbacks, GuessFailed, Limits, descend  # noqa: E402  # noqa: E402
from hybridsens.estimation.growing import Growing  # noqa: E402
from hybridsens.estimation.iterate import BatchSize  # noqa: E402
from hybridsens.estimation.least_squares import linearise  # noqa: E402
from hybridsens.estimation.optimizers import chosen_method  # noqa: E402
from hybridsens.estimation.problem import Problem  # noqa: E402


class Found(NamedTuple):
    """Where a fit ended."""

    values: np.ndarray
    iterations: int


def ours(problem: Problem, strategy: GrowingHorizon | None) -> Found:
    """Levenberg-Marquardt as `fit` runs it, on any kind of problem."""
    how = chosen_method("levenberg-marquardt")
    z = problem.selection.from_values(problem.selection.values(problem.scene))
    how = how if strategy is None else Growing(how, strategy)
    found = descend(how, problem, z, Limits(100, 20), callbacks=Callbacks(batch_size=BatchSize()))
    tried = sum(line.number > 0 for line in found.history)
    return Found(np.asarray(problem.selection.to_values(found.z)), tried)


@eqx.filter_jit
def _residuals(problem: Problem, z):
    r, trial = problem.residuals(z, Replay())
    return jnp.where(trial.failed, 1e3, r)


def scipys(problem: Problem, step: float | None) -> Found:
    """SciPy's trust region on residuals of this package, with its own differences."""
    z = problem.selection.from_values(problem.selection.values(problem.scene))
    done = least_squares(lambda z: np.asarray(_residuals(problem, jnp.asarray(z))), z, diff_step=step, max_nfev=100)
    return Found(np.asarray(problem.selection.to_values(jnp.asarray(done.x))), done.nfev)


def differences(problem: Problem, strategy: GrowingHorizon | None, kind: str) -> Found:
    """The same iterations on differences of this package's motion, over a step chosen in one of three ways."""
    return ours(like(DifferencesProblem, problem, **DIFFERENCES[kind]), strategy)


EPS = float(np.finfo(float).eps)
DIFFERENCES: dict[str, dict] = {
    "over 1e-4": {"step": 1e-4},
    "over sqrt(eps)": {"step": EPS**0.5},
    "central, over cbrt(eps)": {"step": EPS ** (1 / 3), "central": True},
}
"""The best step for motions with errors of 1e-8, and the two of the textbooks."""
GROWING = ", growing horizon"
Run = Callable[[Problem, GrowingHorizon | None], Found]
DERIVATIVES: dict[str, Run] = {
    "sensitivities": ours,
    **{f"differences {kind}": functools.partial(differences, kind=kind) for kind in DIFFERENCES},
    "naive autodiff, 50 steps per sample": lambda p, growing: ours(like(NaiveProblem, p, steps=50), growing),
    "naive autodiff, 200 steps per sample": lambda p, growing: ours(like(NaiveProblem, p, steps=200), growing),
}
SCIPYS: dict[str, Run] = {
    "scipy least_squares, its default differences": lambda p, _: scipys(p, None),
    "scipy least_squares, differences over 1e-4": lambda p, _: scipys(p, 1e-4),
}
METHODS = [*(name + GROWING for name in DERIVATIVES), *DERIVATIVES, *SCIPYS]
ERRORS = {"short": 0.3, "chaotic": 0.1, "long chaotic": 0.1}
"""By how much guesses are off."""


def run_of(name: str, motion: Motion) -> Callable[[Problem], Found]:
    """A method by its name."""
    growing = motion.growing if name.endswith(GROWING) else None
    run = (DERIVATIVES | SCIPYS)[name.removesuffix(GROWING)]
    return lambda problem: run(problem, growing)


def standard_errors(motion: Motion) -> np.ndarray:
    """Of the parameters at the truth: the yardstick for all methods."""
    problem = problem_of(motion, 0, 0.0, 1e-8)
    z = problem.selection.from_values(problem.selection.values(problem.scene))
    _, jacobian, _ = linearise(problem, z)
    by_p = np.asarray(jacobian) / np.asarray(jax.jvp(problem.selection.to_values, (z,), (jnp.ones_like(z),))[1])
    return np.sqrt(np.diag(np.linalg.inv(by_p.T @ by_p)))


def timed(run: Callable[[Problem], Found], problem: Problem, repeats: int = 3) -> tuple[Found, float]:
    """Where a fit ends, and its seconds: the least of some runs."""
    found, quickest = Found(np.full(len(problem.selection.labels), np.inf), 0), np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        try:
            found = run(problem)
        except GuessFailed:
            pass
        quickest = min(quickest, time.perf_counter() - begin)
    return found, quickest


def row(motion_name: str, name: str, error: float, records: int, tolerance: float) -> dict:
    """One method on all records."""
    motion = MOTIONS[motion_name]
    run, errors = run_of(name, motion), standard_errors(motion)
    good, iterations, seconds = [], [], []
    for seed in range(-1, records):  # the first one compiles
        found, quickest = timed(run, problem_of(motion, max(seed, 0), error, tolerance))
        seconds.append(quickest)
        good.append(bool(np.all(np.abs(found.values - motion.values) <= 3 * errors)))
        iterations.append(found.iterations)
    counts = [count for count, success in zip(iterations[1:], good[1:], strict=True) if success]
    return {
        "motion": motion_name, "method": name, "guess off by": error, "tolerance": tolerance, "records": records,
        "recovered": sum(good[1:]), "iterations, median": np.median(counts) if counts else np.nan,
        "iterations, all fits": np.median(iterations[1:]), "seconds, median": np.median(seconds[1:]),
        "seconds per recovery": sum(seconds[1:]) / max(sum(good[1:]), 1) if counts else np.inf,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--motions", nargs="+", default=list(ERRORS), choices=list(ERRORS))
    parser.add_argument("--error", type=float, help="of the guesses; default 0.3, of the chaotic motion 0.1")
    parser.add_argument("--tolerance", type=float, nargs="+", default=[1e-8], help="of the motions")
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS)
    asked = parser.parse_args()
    cases = itertools.product(asked.motions, asked.tolerance, asked.methods)
    rows = [
        show(row(motion, name, asked.error or ERRORS[motion], asked.records, tolerance))
        for motion, tolerance, name in cases
    ]
    write("fit_against_naive", rows)


if __name__ == "__main__":
    main()
