"""Dormand-Prince 5 with adaptive steps, landing on impacts, and the saltation of all derivatives there.

Steps are chosen by the error of all rows of x (see `numba_problems`). A step that ends beyond the obstacle is
repeated with a length found by Newton's method until it ends on it, so that no interpolant stands between the
solver and the event.
"""

import importlib.util

import numpy as np

if importlib.util.find_spec("numba") is not None:
    from numba import njit

NODES = np.array([0.0, 0.2, 0.3, 0.8, 8 / 9, 1.0, 1.0])
WEIGHTS = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
    [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
    [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])  # fmt: skip
ERROR = np.array([71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


def compile_step_error(columns):
    """The error of a step, relative to a tolerance: (h, x, stage, rates, tolerance), x of so many columns."""

    @njit(fastmath=True)
    def step_error(h, x, stage, rates, tolerance):
        total = 0.0
        for k in range(x.shape[0]):
            for i in range(columns):
                error = 0.0
                for j in range(7):
                    error += ERROR[j] * rates[j, k, i]
                scale = tolerance * (1 + max(abs(x[k, i]), abs(stage[k, i])))
                total += (h * error / scale) ** 2
        return np.sqrt(total / (x.shape[0] * columns))

    return step_error


def compile_integrator(definition):
    """The integrator of one problem: (parameters, tolerance, horizon, x), which fills x."""
    start, field, gap, parameter_count = definition()
    start, field, gap = njit(start), njit(field, fastmath=True), njit(gap)
    step_error = compile_step_error(3)

    @njit(fastmath=True)
    def step(t, h, x, p, rates, stage):
        """One step from rates[0] = field(t, x) into `stage`; rates[6] is the rate at its end."""
        for s in range(1, 7):
            for k in range(x.shape[0]):
                for i in range(3):
                    total = 0.0
                    for j in range(s):
                        total += WEIGHTS[s, j] * rates[j, k, i]
                    stage[k, i] = x[k, i] + h * total
            field(t + NODES[s] * h, stage, p, rates[s])

    @njit
    def impact(t, x, p, rates):
        """Reset and saltation, rates[0] being the rate before on entry and the rate after on return."""
        e, v = p[-1], x[0, 1]
        velocity, acceleration, after = rates[0, 0, 0], rates[0, 0, 1], rates[1]
        _, gap_rate, gap_q, moved_by = gap(x, p)
        x[0, 1] = -e * v
        field(t, x, p, after)
        for k in range(1, x.shape[0]):
            shift = -(gap_q * x[k, 0] + (1.0 if k - 1 == moved_by else 0.0)) / gap_rate
            x[k, 0] += (velocity - after[0, 0]) * shift
            x[k, 1] = -e * x[k, 1] - (e * acceleration + after[0, 1]) * shift
            if k == parameter_count:
                x[k, 1] -= v
        field(t, x, p, rates[0])

    @njit
    def integrate(p, tolerance, horizon, x):
        rates, stage = np.empty((7,) + x.shape), np.empty(x.shape)
        t, h = 0.0, 1e-3
        x[:] = 0.0
        start(p, x)
        field(t, x, p, rates[0])
        while t < horizon:
            h = min(h, horizon - t)
            step(t, h, x, p, rates, stage)
            error = step_error(h, x, stage, rates, tolerance)
            if error > 1.0:
                h *= max(0.2, 0.9 * error**-0.2)
                continue
            growth = min(5.0, 0.9 * max(error, 1e-10) ** -0.2)
            distance, gap_rate, _, _ = gap(stage, p)
            hit = distance < 0.0
            if hit:
                short, long, next_h = 0.0, h, h
                for _ in range(50):
                    if distance < 0.0:
                        long = h
                    else:
                        short = h
                    if abs(distance) < 1e-14:
                        break
                    h -= distance / gap_rate
                    if not short < h < long:
                        h = 0.5 * (short + long)
                    step(t, h, x, p, rates, stage)
                    distance, gap_rate, _, _ = gap(stage, p)
                h, growth = h, next_h / h
            t = horizon if h == horizon - t else t + h
            x[:], rates[0] = stage, rates[6]
            if hit:
                impact(t, x, p, rates)
            h *= growth

    return integrate, 1 + parameter_count
