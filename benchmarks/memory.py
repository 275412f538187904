"""Peak memory of one gradient over many impacts of an elastic ball: what each gradient method adds to the process.

    python -m benchmarks.memory --impacts 10000

Each method runs in a process of its own. "Added" is its peak resident memory less that before the gradient was compiled
and run; "plan" is what the compiler says it allocates. The exact gradient is known, so the error stands beside it.
Rows also go to results/memory.csv, in bytes.
"""

import argparse
import ast
import csv
import json
import math
import resource
import subprocess
import sys
import time
from pathlib import Path

from tests.problems.elastic_ball import GRAVITY, exact_slope

from .machine import describe

METHODS = (
    "Replay()", "Replay(recompute=True)", "ForwardSensitivities()", "ContinuousCostate()", "DiffraxAdjoint()",
)  # fmt: skip
COLUMNS = ("method", "plan", "running", "compiling", "error", "seconds", "impacts", "failure")


def measure(method: str, impacts: int, tolerance: float) -> dict[str, float]:
    """Run one gradient in this process. Returns memory [bytes], error, time [s] and the number of impacts seen."""
    import hybridsens as hs
    from hybridsens.scenes import BouncingBall

    hs.configure()
    import jax
    import jax.numpy as jnp

    adjoint = make_method(hs, method)
    horizon = (2 * impacts - 0.5) * math.sqrt(2 / GRAVITY)

    def final_height(height):
        scene = BouncingBall(height=height, restitution_coefficient=1.0)
        motion = hs.simulate(
            scene, scene.initial_state(), t1=horizon, rtol=tolerance, atol=tolerance, adjoint=adjoint,
            max_events=impacts + 2, max_steps=16 * impacts, throw=False,
        )  # fmt: skip
        return motion.final.q[0], motion.events.count

    differentiate = jax.jacfwd if method.startswith("Forward") else jax.grad
    gradient = jax.jit(differentiate(final_height, has_aux=True))
    q0 = jnp.array(1.0)
    before = _peak()
    compiled = gradient.lower(q0).compile()
    after_compilation = _peak()
    slope, count = jax.block_until_ready(compiled(q0))
    start = time.perf_counter()
    jax.block_until_ready(compiled(q0))
    seconds = time.perf_counter() - start
    plan = compiled.memory_analysis()
    known = exact_slope(impacts, horizon)
    return dict(
        compiling=after_compilation - before, running=_peak() - after_compilation,
        plan=plan.temp_size_in_bytes + plan.output_size_in_bytes + plan.argument_size_in_bytes,
        error=abs(float(slope) - known) / abs(known), seconds=seconds, impacts=int(count),
    )  # fmt: skip


def make_method(hs, text: str):
    """`Replay()` as an object. Raises: TypeError or AttributeError if this version does not have it."""
    call = ast.parse(text, mode="eval").body
    assert isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
    return getattr(hs, call.func.id)(**{word.arg: ast.literal_eval(word.value) for word in call.keywords if word.arg})


def _peak() -> int:
    """Largest resident memory of this process so far [bytes]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # kilobytes on Linux


def in_its_own_process(method: str, impacts: int, tolerance: float) -> dict:
    """What `measure` returns there, or why it failed."""
    asked = [f"--impacts={impacts}", f"--tolerance={tolerance}", f"--method={method}"]
    run = subprocess.run([sys.executable, "-m", "benchmarks.memory", *asked], capture_output=True, text=True)
    if run.returncode:
        return {"method": method, "failure": (run.stderr.strip().splitlines() or ["no message"])[-1]}
    return {"method": method, **json.loads(run.stdout.splitlines()[-1])}


def show(row: dict) -> None:
    """Print a row, in megabytes."""
    if "failure" in row:
        print(f"{row['method']:26}  failed: {row['failure']}")
        return
    widths = {"plan": 9, "running": 12, "compiling": 14}
    sizes = "".join(f"{row[name] / 1e6:>{width}.1f}" for name, width in widths.items())
    print(f"{row['method']:26}{sizes}{row['error']:>10.1e}{row['seconds']:>9.2f}{row['impacts']:>9}", flush=True)


def main() -> None:
    """Print one row for each method, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--impacts", type=int, default=10_000)
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--method", help="only this one, in this process, as JSON")
    parser.add_argument("--csv", type=Path, default=Path("results/memory.csv"))
    arguments = parser.parse_args()
    if arguments.method:
        print(json.dumps(measure(arguments.method, arguments.impacts, arguments.tolerance)))
        return
    print(f"{'':26}{'plan MB':>9}{'running MB':>12}{'compiling MB':>14}{'error':>10}{'seconds':>9}{'impacts':>9}")
    rows = []
    for method in METHODS:
        rows.append(in_its_own_process(method, arguments.impacts, arguments.tolerance))
        show(rows[-1])
    arguments.csv.parent.mkdir(exist_ok=True)
    with arguments.csv.open("w", newline="") as file:
        file.write(f"# {json.dumps(describe())}\n")
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    main()
