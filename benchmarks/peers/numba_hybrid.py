"""Hand-written numba for hybrid systems: Dormand-Prince 5 that lands on events, and the saltation of all derivatives.

`numba_systems` has the systems. The state and its derivatives by every parameter are rows of one array x, as in
`numba_integrator`; a solve without derivatives has the first row alone. A state's guard is landed on by Newton's method
with true steps; times that are known, a clock's or an input's, are stepped to and not searched for.
"""

import importlib.util
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from .numba_integrator import NODES, WEIGHTS, compile_step_error

if importlib.util.find_spec("numba") is not None:
    from numba import njit


class Definition(NamedTuple):
    """A system by hand. `mode` is an array of two integers, changed in place; TIMED is the event of a known time."""

    columns: int
    """Length of the state, the running cost's integral being the last."""
    parameters: int
    start: Callable
    """(p, x, mode), which fills both."""
    field: Callable
    """(t, x, p, mode, rate)"""
    guard: Callable
    """(t, x, rate, p, mode) -> the guard and its rate, of the first row."""
    guard_row: Callable
    """(t, x, p, mode, k) -> derivative of the guard in row k, at a fixed time."""
    known_time: Callable
    """(p, mode) -> the next known time."""
    known_row: Callable
    """(p, mode, k) -> its derivative in row k."""
    reset: Callable
    """(timed, x, p, mode), which changes both; whether the event was one of a known time."""


@cache
def compiled(definition: Definition):
    """(p, tolerance, horizon, rows) -> cost and its derivatives, and a batch of that on one thread."""
    columns = definition.columns
    functions = (njit(f, fastmath=True) for f in definition[2:])
    start, field, guard, guard_row, known_time, known_row, reset = functions
    step_error = compile_step_error(columns)

    @njit(fastmath=True)
    def step(t, h, x, p, mode, rates, stage):
        for s in range(1, 7):
            for k in range(x.shape[0]):
                for i in range(columns):
                    total = 0.0
                    for j in range(s):
                        total += WEIGHTS[s, j] * rates[j, k, i]
                    stage[k, i] = x[k, i] + h * total
            field(t + NODES[s] * h, stage, p, mode, rates[s])

    @njit
    def event(t, timed, falls, x, p, mode, rates):
        """Each row moves on to its own event, is reset, and moves back: rates[0] before on entry, after on return."""
        shift = np.zeros(x.shape[0])
        for k in range(1, x.shape[0]):
            shift[k] = known_row(p, mode, k) if timed else -guard_row(t, x, p, mode, k) / falls
            for i in range(columns):
                x[k, i] += rates[0, 0, i] * shift[k]
        reset(timed, x, p, mode)
        field(t, x, p, mode, rates[0])
        for k in range(1, x.shape[0]):
            for i in range(columns):
                x[k, i] -= rates[0, 0, i] * shift[k]
        field(t, x, p, mode, rates[0])

    @njit
    def solve(p, tolerance, horizon, rows):
        x, mode = np.zeros((rows, columns)), np.zeros(2, np.int64)
        rates, stage = np.empty((7, rows, columns)), np.empty((rows, columns))
        t, free = 0.0, 1e-3
        start(p, x, mode)
        field(t, x, p, mode, rates[0])
        while t < horizon:
            stop = min(horizon, known_time(p, mode))
            h = min(free, stop - t)
            step(t, h, x, p, mode, rates, stage)
            error = step_error(h, x, stage, rates, tolerance)
            if error > 1.0:
                free = h * max(0.2, 0.9 * error**-0.2)
                continue
            free = max(free if h < free else 0.0, h * min(5.0, 0.9 * max(error, 1e-10) ** -0.2))
            value, falls = guard(t + h, stage, rates[6], p, mode)
            hit = value < 0.0
            if hit:
                short, long = 0.0, h
                for _ in range(50):
                    if value < 0.0:
                        long = h
                    else:
                        short = h
                    if abs(value) < 1e-13:
                        break
                    h -= value / falls
                    if not short < h < long:
                        h = 0.5 * (short + long)
                    step(t, h, x, p, mode, rates, stage)
                    value, falls = guard(t + h, stage, rates[6], p, mode)
            timed = not hit and h == stop - t and stop < horizon
            t = stop if h == stop - t else t + h
            x[:], rates[0] = stage, rates[6]
            if hit or timed:
                event(t, timed, falls, x, p, mode, rates)
        return x[:, columns - 1].copy()

    @njit
    def batch(many, tolerance, horizon, rows):
        out = np.empty((len(many), rows))
        for sample in range(len(many)):
            out[sample] = solve(many[sample], tolerance, horizon, rows)
        return out

    return solve, batch
