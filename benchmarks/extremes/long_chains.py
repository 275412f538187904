"""An elastic ball over 1,000 to 100,000 impacts: energy, event times, gradient in closed form; memory and time.

python -m benchmarks.extremes.long_chains --impacts 1000 10000 100000
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

from tests.problems.elastic_ball import GRAVITY, chain_errors, exact_slope, final_height_of

from .report import Row, main_of, status_name


def study(impacts: list[int]) -> list[Row]:
    """One block of rows for each number of impacts; time and memory as multiples of the first's."""
    rows, base = [], None
    for count in impacts:
        horizon = (2 * count - 0.5) * np.sqrt(2 / GRAVITY)
        compiled = jax.jit(jax.value_and_grad(final_height_of(count, horizon), has_aux=True)).lower(1.0).compile()
        (_, motion), slope = compiled(jnp.array(1.0))
        plan = compiled.memory_analysis()
        cost = np.array([_shortest_time(compiled), plan.temp_size_in_bytes + plan.output_size_in_bytes]) / count
        base = cost if base is None else base
        errors = chain_errors(motion, count) | {
            "gradient": abs(float(slope) / exact_slope(count, horizon) - 1),
            "seconds per impact": cost[0],
            "seconds per impact, against the shortest": cost[0] / base[0],
            "memory per impact, against the shortest": cost[1] / base[1],
        }
        rows += [Row("long chains", name, count, float(size), status_name(motion)) for name, size in errors.items()]
    return rows


def _shortest_time(compiled, repeats: int = 5) -> float:
    """Of several runs of value and gradient [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(compiled(jnp.array(1.0)))
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--impacts", type=int, nargs="+", default=[1000, 10_000, 100_000])
    main_of("long_chains", lambda arguments: study(arguments.impacts), parser)


if __name__ == "__main__":
    main()
