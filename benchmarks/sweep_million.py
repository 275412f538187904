"""A million points of P1, value and gradient, to a Zarr store; killed at a random moment and resumed.

    python -m benchmarks.sweep_million [--points 1000000] [--folder /tmp/million]

Three runs: uninterrupted (time and peak memory), killed with SIGKILL, resumed. Then both stores are compared, chunk by
chunk: every point present, equal to the last bit, and no finished chunk written a second time.
"""

import argparse
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    """Run the three runs and print what came out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--folder", type=Path, default=None)
    parser.add_argument("--worker", type=Path, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        run(arguments.worker, arguments.points)
        return
    folder = arguments.folder or Path(tempfile.mkdtemp())
    whole, broken = folder / "whole.zarr", folder / "broken.zarr"
    for store in (whole, broken):
        shutil.rmtree(store, ignore_errors=True)
    seconds = finish(whole, arguments.points)
    kept = kill(broken, arguments.points, random.uniform(0.2, 0.8))
    finish(broken, arguments.points)
    after = chunks(broken)
    rewritten = sum(after[path] != written for path, written in kept.items())
    print(f"killed with {len(kept)} of {len(after)} chunks done; {rewritten} of them written again by the resumed run")
    compare(whole, broken)
    print(f"uninterrupted: {arguments.points:,} points in {seconds:.1f} s, start and compilation included")


def run(store: Path, points: int) -> None:
    """The sweep itself, in a process of its own."""
    import hybridsens

    hybridsens.configure(host_devices=os.cpu_count())
    from benchmarks.sweep_problems import make_cost, scenes
    from hybridsens.sweeps import sweep

    sweep(make_cost("P1"), scenes("P1", points), store=store, chunk=8192, events=4)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


def start(store: Path, points: int) -> subprocess.Popen:
    """A process that sweeps."""
    command = [sys.executable, "-m", "benchmarks.sweep_million", "--points", str(points), "--worker", str(store)]
    return subprocess.Popen(command)


def finish(store: Path, points: int) -> float:
    """Run to the end; seconds."""
    begin = time.perf_counter()
    if start(store, points).wait() != 0:
        raise SystemExit("the sweep failed")
    return time.perf_counter() - begin


def kill(store: Path, points: int, share: float) -> dict[Path, int]:
    """Kill when about that share of the chunks is there; the chunks that were done."""
    process, total = start(store, points), -(-points // 8192)
    while len(chunks(store)) < share * total:
        if process.poll() is not None:
            raise SystemExit("the sweep ended before it could be killed")
        time.sleep(random.uniform(0, 0.02))
    process.send_signal(signal.SIGKILL)
    process.wait()
    return chunks(store)


def chunks(store: Path) -> dict[Path, int]:
    """When each chunk's status was written."""
    return {path: path.stat().st_mtime_ns for path in store.glob("status/c/*") if path.suffix != ".partial"}


def compare(whole: Path, broken: Path) -> None:
    """Every point there, and the same."""
    import xarray as xr

    one, other = (xr.open_zarr(store, chunks=None).load() for store in (whole, broken))
    present = int((other.status >= 0).sum())
    xr.testing.assert_equal(one, other)
    successful = int((other.status == 0).sum())
    print(f"{present:,} points present, {successful:,} successful, all equal to the uninterrupted run's")


if __name__ == "__main__":
    main()
