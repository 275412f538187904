"""What every figure is written beside: machine, versions, commit."""

import contextlib
import os
import platform
import subprocess
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
