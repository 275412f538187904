"""What does a sweep gain on a GPU, and are its gradients the same there?

    python -m benchmarks.gpu [--most 100000] [--devices cpu cuda]

Value and gradient by all parameters of 1000 and 100,000 motions at rtol = atol = 1e-8, in double precision: on all
cores of the processor, each with a motion at a time, and on the GPU, where all motions run in step. Each device has a
process of its own, since JAX has one default device. Beside each time stand the first call, which compiles, and the
largest difference of a gradient from the first device's, relative to that gradient's largest entry. Rows also go to
results/gpu.csv.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from .machine import describe
from .rows import show, write

SIZES = (1_000, 100_000, 1_000_000)
REPEATS = 3


def main() -> None:
    """Measure each device, compare, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=100_000)
    parser.add_argument("--devices", nargs="+", default=["cpu", "cuda"])
    parser.add_argument("--here", type=Path, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.here:
        measure(arguments.here, [size for size in SIZES if size <= arguments.most])
        return
    print(json.dumps(describe()))
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / f"{device}.npz" for device in arguments.devices]
        for device, file in zip(arguments.devices, files, strict=True):
            run_on(device, file, arguments.most)
        rows = [show(row) for file in files for row in beside(files[0], file)]
    write("gpu", rows)


def run_on(device: str, file: Path, most: int) -> None:
    """Measure a device in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.gpu", "--here", str(file), "--most", str(most)]
    subprocess.run(command, check=True, env={**os.environ, "JAX_PLATFORMS": device})


def beside(first: Path, file: Path) -> Iterator[dict]:
    """Rows of one device, with how much faster it is than the first, and how far its gradients are from that one's."""
    expected, found = np.load(first), np.load(file)
    earlier = {(row["problem"], row["motions"]): row for row in json.loads(str(expected["rows"]))}
    for row in json.loads(str(found["rows"])):
        key = row["problem"], row["motions"]
        own, other = found[name_of(*key)], expected[name_of(*key)]
        apart = (np.abs(own - other).max(-1) / np.abs(other).max(-1)).max()
        yield {**row, "faster by": earlier[key]["seconds"] / row["seconds"], "difference": float(apart)}


def name_of(problem: str, motions: int) -> str:
    """Under what a file holds the gradients of a batch."""
    return f"{problem} of {motions}"


def measure(file: Path, sizes: list[int]) -> None:
    """Leave rows and gradients of this process's device in a file."""
    import hybridsens as hs

    hs.configure(host_devices=os.cpu_count())
    rows, gradients = [], {}
    for problem in ("P1", "P2", "cylinder"):
        for size in sizes:
            call = sweep_of(problem, size)
            first, _ = seconds(call)
            taken, (gradient, failed) = min((seconds(call) for _ in range(REPEATS)), key=lambda pair: pair[0])
            gradients[name_of(problem, size)] = gradient
            rows.append({
                "device": device_name(), "problem": problem, "motions": size, "seconds": taken,
                "gradients/s": size / taken, "first call": first, "failed": failed,
            })  # fmt: skip
            print(rows[-1], file=sys.stderr, flush=True)
    np.savez(file, rows=json.dumps(rows), **gradients)


def sweep_of(problem: str, size: int) -> Callable:
    """A call that gives the gradients, (motion, parameter), and how many motions failed."""
    import equinox as eqx
    import jax

    import hybridsens as hs
    from hybridsens.sweeps import sweep

    from .sweep_problems import make_cost, scenes

    if problem == "cylinder":
        repeated = jax.tree.map(lambda leaf: np.full(size, leaf), hs.scenes.CylinderSlide())
        angles = np.linspace(0.1, 0.3, size)
        cost, batch = slide_cost, eqx.tree_at(lambda scene: scene.angle, repeated, angles)
    else:
        cost, batch = make_cost(problem), scenes(problem, size)

    def call():
        found = sweep(cost, batch, chunk=size, events=0, progress=False)
        gradient = [found[name].values for name in found if str(name).startswith("dJ_d")]
        return np.stack(gradient, -1), int((found.status != 0).sum())

    return call


def slide_cost(scene):
    """Where a mass that slides off a cylinder is at the end, after the release and two or three bounces."""
    import hybridsens as hs

    motion = hs.simulate(scene, scene.initial_state(), t1=2.0, max_events=8, max_steps=128, throw=False)
    return motion.final.q[0], motion


def device_name() -> str:
    """The accelerator's name, or the processor's with its cores."""
    import jax

    device = jax.devices()[0]
    return f"{describe()['processor']}, {os.cpu_count()} cores" if device.platform == "cpu" else device.device_kind


def seconds(call: Callable) -> tuple[float, tuple]:
    """How long a call takes, and its result."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


if __name__ == "__main__":
    main()
