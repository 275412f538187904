"""Errors against the known values and gradients, and one printed row of comparison with them."""

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from tests.problems.references import load


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
