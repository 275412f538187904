"""What does one exact gradient cost: against its own forward solve, against plain autodiff, against compiled code?

    python -m benchmarks.gradient_cost             # reference problems, batches, shipped scenes, no contacts at all
    python -m benchmarks.gradient_cost --quick     # P2 alone

One run on one machine and one core of it, so compare the ratios. Compile times, with all cores, stand apart. The plain
chain of Diffrax events is timed twice: under the settings of `hybridsens.configure()`, which help it too, and in a
process of its own under JAX's own settings, as somebody without this package runs it. Rows also go to
results/gradient_cost.csv.
"""

import argparse
import json
import statistics
import time

import hybridsens as hs
from tests.problems import references

from .machine import describe, one_core, under_default_settings
from .peers import casadi_c, diffrax_chain, reference
from .rows import show, write

TOLERANCE = 1e-8


def timed(function, *arguments, calls: int = 400):
    """Median seconds of a call on one core that waits for its result, and seconds of the first call, which compiles."""
    import jax

    start = time.perf_counter()
    jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - start
    with one_core():
        start, times = time.perf_counter(), []
        while len(times) < 9 or (len(times) < calls and time.perf_counter() - start < 3):
            begin = time.perf_counter()
            jax.block_until_ready(function(*arguments))
            times.append(time.perf_counter() - begin)
    return statistics.median(times), first


def problem_row(problem: str) -> dict:
    """This package, the plain chain of Diffrax events and CasADi's generated C on one reference problem."""
    import jax
    import jax.numpy as jnp

    from tests.problems.reference_scenes import cost

    known = references.load(problem)
    p = jnp.asarray(known.parameters)
    ours = lambda p: cost(problem, p, TOLERANCE)
    chain = lambda p: diffrax_chain.cost(problem, p, TOLERANCE)
    forward, _ = timed(jax.jit(ours), p)
    gradient, compile_seconds = timed(jax.jit(jax.value_and_grad(ours)), p)
    plain, plain_compile = timed(jax.jit(jax.value_and_grad(chain)), p)
    error = reference.errors(problem, *jax.value_and_grad(ours)(p)).gradient
    row = {
        "what": problem, "forward_us": forward * 1e6, "gradient_us": gradient * 1e6,
        "gradient/forward": gradient / forward,
        "compile_s": compile_seconds, "gradient_error": error, "chain_us": plain * 1e6, "chain/ours": plain / gradient,
        "chain_compile_s": plain_compile,
    }  # fmt: skip
    as_installed = under_default_settings("gradient_cost", f"--chain-alone={problem}")
    row |= {"default_chain_us": as_installed * 1e6, "default_chain/ours": as_installed / gradient}
    if casadi_c.available() is None and problem != "P3":
        best = min(_casadi_seconds(problem, known.parameters, mode) for mode in ("adjoint", "forward"))
        row |= {"casadi_us": best * 1e6, "casadi/ours": best / gradient}
    elif problem != "P3":
        row |= {"casadi_us": casadi_c.available()}
    return row


def chain_alone(problem: str) -> float:
    """Seconds per gradient of the plain chain in a process where only double precision was asked for."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    chain = lambda p: diffrax_chain.cost(problem, p, TOLERANCE)
    return timed(jax.jit(jax.value_and_grad(chain)), jnp.asarray(references.load(problem).parameters))[0]


def _casadi_seconds(problem: str, parameters, mode: str) -> float:
    """Seconds per gradient inside a loop in C, so without Python's share."""
    import numpy as np

    _, gradient = casadi_c.build(problem, mode=mode)
    many = np.tile(parameters, (200, 1))
    gradient.many(many)
    times = []
    with one_core():
        for _ in range(9):
            start = time.perf_counter()
            gradient.many(many)
            times.append((time.perf_counter() - start) / len(many))
    return statistics.median(times)


def batch_row(problem: str, lanes: int) -> dict:
    """Gradients per second over a batch on one core: mapped, under `jax.vmap`, and the vmapped plain chain."""
    import jax
    import jax.numpy as jnp

    from tests.problems.reference_scenes import cost

    p = jnp.asarray(references.load(problem).parameters)
    points = p * (1 + 1e-3 * jax.random.uniform(jax.random.key(0), (lanes, p.shape[0]), minval=-1.0))
    points = jnp.minimum(points, p)  # a restitution of 1 must not be passed
    ours = jax.grad(lambda p: cost(problem, p, TOLERANCE))
    chain = jax.grad(lambda p: diffrax_chain.cost(problem, p, TOLERANCE))
    seconds = {
        "mapped": timed(jax.jit(lambda points: jax.lax.map(ours, points)), points)[0],
        "vmap": timed(jax.jit(jax.vmap(ours)), points)[0],
        "chain": timed(jax.jit(jax.vmap(chain)), points)[0],
    }
    rates = {f"{name}_per_s": lanes / taken for name, taken in seconds.items()}
    return {"what": f"{problem}, {lanes} lanes", **rates, "mapped/chain": seconds["chain"] / seconds["mapped"]}


def scene_row(name: str) -> dict:
    """A shipped scene: forward solve, gradient by every parameter, compilation."""
    import equinox as eqx

    scene = hs.scenes.SCENES[name]()
    running_cost = lambda scene, t, q, v: scene.running_cost(t, q, v)

    def cost(scene):
        state = scene.initial_state()
        return hs.simulate(scene, state, t1=scene.t1, running_cost=running_cost, throw=False).cost

    forward, _ = timed(eqx.filter_jit(cost), scene)
    gradient, compile_seconds = timed(eqx.filter_jit(eqx.filter_value_and_grad(cost)), scene)
    return {
        "what": name, "forward_us": forward * 1e6, "gradient_us": gradient * 1e6,
        "gradient/forward": gradient / forward,
        "compile_s": compile_seconds,
    }  # fmt: skip


def main() -> None:
    """Run and print; write the rows with the machine and the versions beside them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="P2 alone")
    parser.add_argument("--lanes", type=int, default=1000)
    parser.add_argument("--chain-alone", metavar="PROBLEM", help="only the plain chain, under JAX's own settings")
    quick, lanes = (arguments := parser.parse_args()).quick, arguments.lanes
    if arguments.chain_alone:
        print(chain_alone(arguments.chain_alone))
        return
    hs.configure()
    print(json.dumps(describe()))
    rows = [show(problem_row(problem)) for problem in (["P2"] if quick else ["P2", "P1", "P3", "P4"])]
    if not quick:
        rows += [show(batch_row(problem, lanes)) for problem in ("P2", "P1")]
        rows += [show(scene_row(name)) for name in hs.scenes.SCENES]
    write("gradient_cost", rows)


if __name__ == "__main__":
    main()
