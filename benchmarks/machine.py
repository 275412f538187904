"""What every figure is written beside: machine, versions, commit."""

import os
import platform
import subprocess
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


def _processor() -> str:
    try:
        with open("/proc/cpuinfo") as file:
            return next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def _commit() -> str:
    done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"
