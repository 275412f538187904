"""The known values and gradients (`references.json`), and one printed row of comparison with them."""

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

# Index of the functional that is compared where a problem has several: P1 'int q^2', P3 'x(T)'.
DEFAULT_FUNCTIONAL = {"P1": 1, "P2": 0, "P2b": 0, "P3": 0, "P4": 0}


class Reference(NamedTuple):
    parameters: np.ndarray  # nominal values, in the order of `names`
    names: tuple[str, ...]
    value: float
    gradient: np.ndarray  # one entry per parameter
    event_count: int


def load(problem: str, functional: int | None = None) -> Reference:
    """The reference of one problem, rounded from 30 digits to float64."""
    record = json.loads((Path(__file__).parents[2] / "tests" / "references.json").read_text())[problem]
    index = DEFAULT_FUNCTIONAL[problem] if functional is None else functional
    gradient = np.array([float(entry) for entry in record["dJ"][index]])
    parameters, value = np.array(record["p"]), float(record["J"][index])
    return Reference(parameters, tuple(record["names"]), value, gradient, record["n_events"])


class Errors(NamedTuple):
    value: float  # relative
    gradient: float  # the worst entry's, relative to the largest entry
    entry: float  # the largest relative error of an entry that is not exactly zero


def errors(problem: str, value: float, gradient: np.ndarray, functional: int | None = None) -> Errors:
    """How far a value and its gradient are from the reference."""
    known = load(problem, functional)
    size, wrong = np.abs(known.gradient), np.abs(np.asarray(gradient) - known.gradient)
    present = size > 0
    entry = (wrong[present] / size[present]).max()
    return Errors(abs(float(value) - known.value) / abs(known.value), float(wrong.max() / size.max()), float(entry))


def require(reason: str | None) -> None:
    """Raises `ImportError` with what a module's `available()` says, if it says anything."""
    if reason is not None:
        raise ImportError(reason)


def seconds_per_call(call: Callable, *arguments, repeats: int = 9, shortest: float = 0.02) -> float:
    """Median over `repeats` of the time of one call, each repeat lasting at least `shortest` seconds.

    `call` must wait for its own result, and must have been called once before if it compiles.
    """
    start = time.perf_counter()
    call(*arguments)
    calls = max(1, int(shortest / (time.perf_counter() - start)))
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(calls):
            call(*arguments)
        samples.append((time.perf_counter() - start) / calls)
    return statistics.median(samples)


def print_header() -> None:
    times = f"{'forward ms':>12}{'gradient ms':>13}{'compile s':>11}"
    print(f"{'':34}{'value error':>12}{'gradient error':>16}{'worst entry':>13}{times}")


def print_row(name: str, found: Errors, forward_seconds, gradient_seconds, compile_seconds) -> None:
    """One line of the table; a compile time of `None` is left blank."""
    compiled = "" if compile_seconds is None else f"{compile_seconds:.1f}"
    times = f"{1e3 * forward_seconds:12.4f}{1e3 * gradient_seconds:13.4f}{compiled:>11}"
    print(f"{name:34}{found.value:12.1e}{found.gradient:16.1e}{found.entry:13.1e}{times}", flush=True)
