"""What a row of a table tells of a program: the errors of its value and gradient, how long it runs and compiles, in how
much memory, or why it failed."""

import re
import time
from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from .compare_table import Reference
from .functional import raise_unless_reached_end

SHORTEST = 0.01
"""Seconds: calls are timed together until they take as long."""


def seconds_per_call(call: Callable, *, repeats: int = 5) -> float:
    """Time of one call [s]: the least of `repeats` means over at least `SHORTEST` seconds each.

    The least, because whatever else the machine does can only make it longer.
    """
    start = time.perf_counter()
    jax.block_until_ready(call())
    calls = max(1, int(SHORTEST / (time.perf_counter() - start)))
    samples = []
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(calls):
            jax.block_until_ready(call())
        samples.append((time.perf_counter() - start) / calls)
    return min(samples)


def first_call(call: Callable):
    """The result of a first call, and how long it took: tracing, compiling and running once [s]."""
    start = time.perf_counter()
    result = jax.block_until_ready(call())
    return result, time.perf_counter() - start


class Measured(NamedTuple):
    """What a program of a value and its gradient gives."""

    value: float
    gradient: Float[np.ndarray, "parameter"]
    value_error: float
    gradient_error: float
    """Relative to the reference."""
    seconds: float
    """Of one call [s]."""
    first_seconds: float
    """Of the first one [s]."""


def measured(call: Callable, reference: Reference) -> Measured:
    """The program that `call` runs, beside a reference.

    Raises: SimulationError for a motion that is not whole; FloatingPointError for what has no error that could be
    told."""
    (value, gradient, reported), seconds = first_call(call)
    raise_unless_reached_end(reported)
    value, gradient = float(value), np.asarray(gradient, float)
    if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
        raise FloatingPointError(f"not finite: value {value:g}, gradient {gradient}")
    errors = relative_error(value, reference.value), relative_error(gradient, reference.gradient)
    return Measured(value, gradient, *errors, seconds_per_call(call), seconds)


def relative_error(found, known) -> float:
    """The largest deviation, relative to the largest known entry; absolute where all of them are zero."""
    scale = np.max(np.abs(known))
    return float(np.max(np.abs(found - known) / (scale if scale > 0 else 1)))


def planned_memory(function, *arguments) -> int | None:
    """Peak memory [bytes] of a compiled function by the compiler's own plan: arguments, results and temporaries.

    None for a function that is not compiled as a whole, or where the backend does not say.
    """
    if not hasattr(function, "lower"):
        return None
    plan = function.lower(*arguments).compile().memory_analysis()
    if plan is None:
        return None
    return plan.argument_size_in_bytes + plan.output_size_in_bytes + plan.temp_size_in_bytes


LONGEST = 120

_RAISED = re.compile(r"(?:\w+\.)*_?(\w+(?:Error|Exception)): (.+)")
"""The line of a traceback that names what was raised."""


def reason(error: Exception) -> str:
    """Type and first line of an error's message, at most `LONGEST` characters of it. What a compiled program raised
    comes with its traceback in the message: then it is the line at the end of that."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    raised = [found for line in lines if (found := _RAISED.fullmatch(line))]
    if raised and any("Traceback" in line for line in lines):
        kind, message = raised[-1].groups()
    else:
        kind, message = type(error).__name__, lines[0] if lines else "no message"
    return f"{kind}: {message if len(message) <= LONGEST else message[: LONGEST - 3] + '...'}"
