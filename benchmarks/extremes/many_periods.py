"""An oscillator that strikes an elastic wall once a period, over up to a million periods: energy, phase, gradient.

    python -m benchmarks.extremes.many_periods --periods 100 10000 1000000

Energy has to stay as it is; an energy that drifts by a constant share of itself in every period shifts the phase by the
square of the number of periods.
"""

import argparse
import time

import diffrax
import jax
import jax.numpy as jnp

import hybridsens as hs
from tests.problems.elastic_wall import end_of, errors, exact, final_of

from .report import Row, main_of, status_name

EXACT = "Dopri8, tolerance 1e-13"
RUNS = {"Tsit5, tolerance 1e-8": (diffrax.Tsit5(), 1e-8), EXACT: (diffrax.Dopri8(), 1e-13)}
GRADIENTS = {"steps recorded": hs.Replay(), "events alone recorded": hs.Replay(recompute=True)}
MOST = 100_000
"""Periods up to which the gradient is asked for: a million take several minutes."""


def study(counts: list[int]) -> list[Row]:
    """Forward runs with both solvers; the gradient of the more exact one, from records of steps and of events."""
    rows = []
    for periods in counts:
        for name, (solver, tolerance) in RUNS.items():
            final = final_of(periods, solver, tolerance, hs.Replay(recompute=True))
            (end, motion), cost = _run(final, periods)
            found = errors(end, motion.events.count, periods) | cost
            found["steps per period"] = int(motion.steps.accepted) / periods
            rows += _rows(name, periods, found, motion)
        for name, adjoint in GRADIENTS.items() if periods <= MOST else ():
            (slope, motion), cost = _run(_slope(final_of(periods, *RUNS[EXACT], adjoint)), periods)
            expected = jax.jacfwd(exact)(jnp.array(1.0), periods, end_of(periods))[0]
            found = {"relative error": abs(float(slope / expected) - 1)} | cost
            rows += _rows(f"gradient, {name}", periods, found, motion)
    return rows


def _rows(name: str, periods: int, found: dict[str, float], motion) -> list[Row]:
    ends = status_name(motion)
    return [Row("many periods", f"{name}: {what}", periods, size, ends) for what, size in found.items()]


def _slope(final):
    """Derivative of the final q by the amplitude, and the motion."""

    def place(*given):
        end, motion = final(*given)
        return end[0], motion

    return jax.grad(place, has_aux=True)


def _run(function, periods: int):
    """What a function of (a, t0, t1) returns, and what it costs per period: bytes that its plan asks for, seconds."""
    given = [jnp.array(number) for number in (1.0, 0.0, end_of(periods))]
    compiled = jax.jit(function).lower(*given).compile()
    start = time.perf_counter()
    out = jax.block_until_ready(compiled(*given))
    seconds = time.perf_counter() - start
    plan = compiled.memory_analysis()
    size = plan.temp_size_in_bytes + plan.output_size_in_bytes
    return out, {"seconds per period": seconds / periods, "bytes per period": size / periods}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--periods", type=int, nargs="+", default=[100, 10_000, 1_000_000])
    main_of("many_periods", lambda arguments: study(arguments.periods), parser)


if __name__ == "__main__":
    main()
