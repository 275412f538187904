"""Hand-written numba: Dormand-Prince 5 with adaptive steps, forward sensitivities and saltation by hand.

What one writes for a single problem when speed is all that counts: `numba_integrator` has the method,
`numba_problems` the problems.
"""

import importlib.util
import time
from functools import cache, partial

import numpy as np

from tests.problems import references

from . import reference
from .numba_integrator import compile_integrator
from .numba_problems import PROBLEMS

if importlib.util.find_spec("numba") is not None:
    import numba
    from numba import njit, prange


def available() -> str | None:
    """Why this peer cannot run here, or `None` if it can."""
    return None if importlib.util.find_spec("numba") else "numba is not installed (pip install numba)"


@cache
def _compiled(definition):
    """Value alone, value with gradient, and batches of the latter on one thread and on all."""
    reference.require(available())
    integrate, rows = compile_integrator(definition)

    @njit
    def solve(p, tolerance, horizon, row_count):
        x = np.empty((row_count, 3))
        integrate(p, tolerance, horizon, x)
        return x[:, 2].copy()

    @njit
    def value(p, tolerance, horizon):
        return solve(p, tolerance, horizon, 1)

    @njit
    def value_and_gradient(p, tolerance, horizon):
        return solve(p, tolerance, horizon, rows)

    def batch(parameters, tolerance, horizon):
        out = np.empty((len(parameters), rows))
        for sample in prange(len(parameters)):
            out[sample] = solve(parameters[sample], tolerance, horizon, rows)
        return out

    return value, value_and_gradient, njit(batch), njit(batch, parallel=True)


def value_and_gradient(problem: str, parameters, tolerance: float, horizon: float | None = None):
    """The integral of q^2 and its derivative by every parameter."""
    definition, default_horizon = PROBLEMS[problem]
    row = _compiled(definition)[1](np.asarray(parameters, float), tolerance, horizon or default_horizon)
    return row[0], row[1:]


def batch(problem: str, parameters_array, tolerance: float, *, parallel: bool = False, horizon: float | None = None):
    """Values (sample,) and gradients (sample, parameter) for such parameters; `parallel`: on all threads."""
    definition, default_horizon = PROBLEMS[problem]
    run = _compiled(definition)[3 if parallel else 2]
    rows = run(np.ascontiguousarray(parameters_array, float), tolerance, horizon or default_horizon)
    return rows[:, 0], rows[:, 1:]


def main(tolerance: float = 1e-8, batch_size: int = 1000) -> None:
    """Print errors and times; the compile time is that of value and gradient together."""
    reference.require(available())
    reference.print_header()
    for problem, (definition, horizon) in PROBLEMS.items():
        parameters = references.load(problem).parameters
        forward, both, _, _ = _compiled(definition)
        start = time.perf_counter()
        forward(parameters, tolerance, horizon)
        found = reference.errors(problem, *value_and_gradient(problem, parameters, tolerance))
        compile_seconds = time.perf_counter() - start
        forward_seconds = reference.seconds_per_call(forward, parameters, tolerance, horizon)
        gradient_seconds = reference.seconds_per_call(both, parameters, tolerance, horizon)
        reference.print_row(f"{problem} numba", found, forward_seconds, gradient_seconds, compile_seconds)
        many = parameters * np.random.default_rng(0).uniform(0.99, 1.01, (batch_size, len(parameters)))
        for parallel in (False, True):
            run = partial(batch, problem, many, tolerance, parallel=parallel)
            run()
            seconds = reference.seconds_per_call(run)
            threads = numba.get_num_threads() if parallel else 1
            print(f"    batch of {batch_size}, {threads} thread(s): {batch_size / seconds:,.0f} gradients/s")


if __name__ == "__main__":
    main()
