"""Gradients per second of a sweep on all cores, beside a vmapped chain of Diffrax solves and hand-written numba.

    python -m benchmarks.sweep_throughput [--points 10000] [--chain-points 1000]

Every contestant gets value and gradient by all parameters of the same points at rtol = atol = 1e-8, after one run that
compiles. The largest difference to numba's gradients, relative to the largest entry, stands beside each, so that speed
is not bought by error. Processor time counts all cores, and tells more than the clock where others use the machine too.
"""

import argparse
import os
import platform
import time

import hybridsens

CORES = os.cpu_count() or 1
os.environ.setdefault("NUMBA_NUM_THREADS", str(CORES))
hybridsens.configure(host_devices=CORES)

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from benchmarks.peers import diffrax_chain, numba_saltation  # noqa: E402
from benchmarks.sweep_problems import make_cost, points, scenes  # noqa: E402
from hybridsens.sweeps import sweep  # noqa: E402


def main() -> None:
    """Print a table for P1 and P2."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--chain-points", type=int, default=None, help="points for the chain; default: as many")
    arguments = parser.parse_args()
    print(
        f"{platform.processor() or platform.machine()}, {CORES} cores, jax {jax.__version__}, {arguments.points} points"
    )
    print(f"{'':28}{'gradients/s':>14}{'us each':>10}{'CPU us each':>13}{'ours is faster by':>19}{'difference':>12}")
    for name in ("P1", "P2"):
        compare(name, arguments.points, arguments.chain_points or arguments.points)


def compare(name: str, count: int, chain_count: int) -> None:
    """One block of the table."""
    names, values = points(name, count)
    cost, batch = make_cost(name), scenes(name, count)

    def ours():
        found = sweep(cost, batch, events=0, progress=False)
        assert int(found.status.max()) == 0, "some points failed"
        return np.stack([found[f"dJ_d{key}"].values for key in names], -1)

    # The chain is as long as the points need, and no longer.
    most = int(sweep(cost, batch, events=0, progress=False).event_count.max())
    chain_gradient = jax.jit(jax.vmap(jax.value_and_grad(lambda p: diffrax_chain.cost(name, p, 1e-8, max_events=most))))

    def chain():
        return np.asarray(chain_gradient(jnp.asarray(values[:chain_count]))[1])

    expected = numba_saltation.batch(name, values, 1e-8, parallel=True)[1]
    contestants = (
        (f"{name} hybridsens.sweep", ours, count, 3),
        (
            f"{name} numba, {CORES} threads",
            lambda: numba_saltation.batch(name, values, 1e-8, parallel=True)[1],
            count,
            3,
        ),
        (f"{name} vmapped Diffrax chain", chain, chain_count, 1),
    )
    our_rate = None
    for label, call, size, repeats in contestants:
        seconds, busy, gradient = best_of(call, repeats)
        our_rate = our_rate or size / seconds
        difference = (np.abs(gradient - expected[:size]).max(-1) / np.abs(expected[:size]).max(-1)).max()
        rate, each, core = size / seconds, 1e6 * seconds / size, 1e6 * busy / size
        print(f"{label:28}{rate:14,.0f}{each:10.1f}{core:13.1f}{our_rate / rate:19.2f}{difference:12.1e}", flush=True)


def best_of(call, repeats: int):
    """Shortest of some times, and of the processor's, after one call that compiles; and the result."""
    result, walls, cores = call(), [], []
    for _ in range(repeats):
        wall, core = time.perf_counter(), time.process_time()
        call()
        walls.append(time.perf_counter() - wall)
        cores.append(time.process_time() - core)
    return min(walls), min(cores), result


if __name__ == "__main__":
    main()
