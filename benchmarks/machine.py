"""What every figure is written beside: machine, versions, commit."""

import contextlib
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version


def describe() -> dict:
    """Processor, cores, Python, versions of the packages that matter, and the commit."""
    packages = ("jax", "jaxlib", "diffrax", "equinox", "numpy")
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        **{name: version(name) for name in packages},
        "commit": _commit(),
    }


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """All threads of this process on one core, where the system can do that (Linux).

    XLA hands parts of a program from thread to thread; to wake an idle core for them takes longer than a short motion.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    allowed = os.sched_getaffinity(0)
    _put_threads_on({max(allowed)})
    try:
        yield
    finally:
        _put_threads_on(allowed)


def under_default_settings(module: str, *arguments: str) -> float:
    """The last number that `python -m benchmarks.<module> <arguments>` prints, in a process whose environment
    `hybridsens.configure()` has not touched: JAX as it is installed."""
    untouched = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}  # configure() has set them
    asked = [sys.executable, "-m", f"benchmarks.{module}", *arguments]
    run = subprocess.run(asked, capture_output=True, text=True, check=True, env=untouched)
    return float(run.stdout.split()[-1])


def _put_threads_on(cores: set[int]) -> None:
    for thread in os.listdir("/proc/self/task"):
        with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
            os.sched_setaffinity(int(thread), cores)


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _commit() -> str:
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"
