"""What do a motion and a gradient of a thermostat, a neuron and a converter cost, against compiled code and a chain?

    python -m benchmarks.hybrid_cost                # one motion, and 1000 parameter points
    python -m benchmarks.hybrid_cost --points 100

Beside us stand numba code written by hand for each system, with forward sensitivities and saltation, and a scan of
plain Diffrax solves that end at events. The scan is timed twice: under the settings of `hybridsens.configure()`, which
help it too, and in a process of its own under JAX's own settings, as somebody without this package runs it. All at
tolerance 1e-8, on one core, by turns; a time is the shortest of many calls, so compare ratios. Each row has the error
of each gradient against numba's at tolerance 1e-13. Rows also go to results/hybrid_cost.csv.
"""

import argparse
import json
import time
from typing import NamedTuple

import hybridsens as hs

from .machine import describe, one_core, under_default_settings
from .peers import diffrax_systems, numba_hybrid, numba_systems
from .rows import show, write

TOLERANCE = 1e-8


class Case(NamedTuple):
    """One system in the forms of everybody."""

    system: hs.systems.ShippedSystem
    horizon: float
    events: int
    chain: diffrax_systems.Chain
    numba: numba_hybrid.Definition


def cases() -> dict[str, Case]:
    """The ready-made systems; of the neurons one, with eight inputs."""
    import jax.numpy as jnp

    times = jnp.array([0.5, 1.2, 3.0, 4.1, 5.3, 6.8, 8.0, 9.1])
    weights = jnp.array([[2.4, 0.9, 1.3, -0.4, 1.9, 0.7, 1.1, 0.8]])
    lone = hs.systems.Neurons(jnp.array([[-0.3]]), weights, times, jnp.array([0.2]))
    return {
        "thermostat": Case(hs.systems.Thermostat(), 10.0, 10, diffrax_systems.thermostat, numba_systems.thermostat()),
        "neuron": Case(lone, 12.0, 14, diffrax_systems.neuron, numba_systems.neuron(8)),
        "converter": Case(hs.systems.BuckConverter(), 56.0, 17, diffrax_systems.converter, numba_systems.converter()),
    }


def shortest(calls: dict, seconds: float = 6.0) -> dict[str, float]:
    """Shortest time of each call, taken by turns, in seconds; each was called once before."""
    times = {name: [] for name in calls}
    with one_core():
        begin = time.perf_counter()
        while time.perf_counter() - begin < seconds or len(times[next(iter(calls))]) < 5:
            for name, call in calls.items():
                start = time.perf_counter()
                call()
                times[name].append(time.perf_counter() - start)
    return {name: min(taken) for name, taken in times.items()}


def costs(case: Case, unravel):
    """J of a vector of parameters, by us and by the chain."""
    room = dict(rtol=TOLERANCE, atol=TOLERANCE, max_events=case.events + 6, max_steps=1024, throw=False)
    cost = type(case.system).running_cost

    def ours(p):
        system = unravel(p)
        start = system.initial_state(), system.initial_mode()
        return hs.solve(system, *start, t1=case.horizon, running_cost=cost, **room).cost

    chain = lambda p: diffrax_systems.cost(unravel(p), case.chain, case.horizon, TOLERANCE, case.events + 1)
    return ours, chain


def single_row(name: str, case: Case) -> dict:
    """One motion and one gradient by everybody."""
    import jax
    import numpy as np
    from jax.flatten_util import ravel_pytree

    p, unravel = ravel_pytree(case.system)
    ours, chain = costs(case, unravel)
    solve, _ = numba_hybrid.compiled(case.numba)
    values, rows = np.asarray(p), 1 + case.numba.parameters
    compiled, compile_seconds = {}, {}
    for label, function in (("ours", ours), ("chain", chain)):
        start = time.perf_counter()
        compiled[label] = jax.jit(jax.value_and_grad(function)).lower(p).compile()
        compile_seconds[label] = time.perf_counter() - start
        compiled[f"{label}_forward"] = jax.jit(function).lower(p).compile()
    calls = {label: lambda run=run: jax.block_until_ready(run(p)) for label, run in compiled.items()}
    calls["numba_forward"] = lambda: solve(values, TOLERANCE, case.horizon, 1)
    calls["numba"] = lambda: solve(values, TOLERANCE, case.horizon, rows)
    exact = solve(values, 1e-13, case.horizon, rows)[1:]
    wrong = lambda gradient: float(np.abs(np.asarray(gradient) - exact).max() / np.abs(exact).max())
    errors = {label: wrong(compiled[label](p)[1]) for label in ("ours", "chain")} | {
        "numba": wrong(calls["numba"]()[1:])
    }
    calls["numba_forward"]()
    taken = shortest(calls)
    row = {"what": name} | {f"{label}_us": seconds * 1e6 for label, seconds in taken.items()}
    row["gradient/forward"] = taken["ours"] / taken["ours_forward"]
    for peer in ("numba", "chain"):
        row[f"{peer}/ours"] = taken[peer] / taken["ours"]
        row[f"{peer}/ours forward"] = taken[f"{peer}_forward"] / taken["ours_forward"]
    row |= as_installed(name, 1, taken["ours"])
    row |= {f"{label}_error": error for label, error in errors.items()}
    return row | {f"{label}_compile_s": seconds for label, seconds in compile_seconds.items()}


def batch_row(name: str, case: Case, points: int) -> dict:
    """Gradients per second over many parameter points."""
    import jax
    import numpy as np
    from jax.flatten_util import ravel_pytree

    p, unravel = ravel_pytree(case.system)
    many = around(p, points)
    ours, chain = costs(case, unravel)
    _, batch = numba_hybrid.compiled(case.numba)
    values, rows = np.asarray(many), 1 + case.numba.parameters
    compiled = {label: jax.jit(jax.vmap(jax.value_and_grad(f))) for label, f in (("ours", ours), ("chain", chain))}
    compiled["ours_forward"] = jax.jit(jax.vmap(ours))
    calls = {label: lambda run=run: jax.block_until_ready(run(many)) for label, run in compiled.items()}
    calls["numba_forward"] = lambda: batch(values, TOLERANCE, case.horizon, 1)
    calls["numba"] = lambda: batch(values, TOLERANCE, case.horizon, rows)
    expected, found = calls["numba"]()[:, 1:], np.asarray(calls["ours"]()[1])
    for call in calls.values():
        call()
    taken = shortest(calls)
    row = {"what": f"{name}, {points} points"}
    row |= {f"{label}_us_each": seconds / points * 1e6 for label, seconds in taken.items()}
    row["gradient/forward"] = taken["ours"] / taken["ours_forward"]
    row |= {f"{peer}/ours": taken[peer] / taken["ours"] for peer in ("numba", "chain")}
    row["numba/ours forward"] = taken["numba_forward"] / taken["ours_forward"]
    row |= as_installed(name, points, taken["ours"])
    apart = np.abs(found - expected).max(-1) / np.abs(expected).max(-1)
    return row | {"apart_median": float(np.median(apart)), "apart_worst": float(apart.max())}


def around(p, points: int):
    """Many parameter points within 1 % of p."""
    import jax

    return p * (1 + 0.01 * jax.random.uniform(jax.random.key(0), (points, p.size), minval=-1.0))


def as_installed(name: str, points: int, ours: float) -> dict:
    """The chain under JAX's own settings, beside the seconds that we take."""
    asked = f"--only={name}", f"--points={points}"
    seconds = under_default_settings("hybrid_cost", "--chain-alone", *asked)
    each = "default_chain_us" if points == 1 else "default_chain_us_each"
    return {each: seconds / points * 1e6, "default_chain/ours": seconds / ours}


def chain_alone(name: str, points: int) -> float:
    """Seconds of the chain's gradient, at so many points, in a process where only double precision was asked for."""
    import jax
    from jax.flatten_util import ravel_pytree

    jax.config.update("jax_enable_x64", True)
    case = cases()[name]
    p, unravel = ravel_pytree(case.system)
    gradient = jax.value_and_grad(costs(case, unravel)[1])
    run, given = (jax.jit(gradient), p) if points == 1 else (jax.jit(jax.vmap(gradient)), around(p, points))
    call = lambda: jax.block_until_ready(run(given))
    call()
    return shortest({"chain": call})["chain"]


def main() -> None:
    """Run and print; write the rows with the machine and the versions beside them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=1000)
    parser.add_argument("--only", choices=("thermostat", "neuron", "converter"))
    parser.add_argument("--chain-alone", action="store_true", help="only the chain of --only, under JAX's own settings")
    arguments = parser.parse_args()
    if arguments.chain_alone:
        print(chain_alone(arguments.only, arguments.points))
        return
    hs.configure()
    print(json.dumps(describe()))
    chosen = {name: case for name, case in cases().items() if arguments.only in (None, name)}
    rows = [show(single_row(name, case)) for name, case in chosen.items()]
    rows += [show(batch_row(name, case, arguments.points)) for name, case in chosen.items()]
    write("hybrid_cost", rows)


if __name__ == "__main__":
    main()
