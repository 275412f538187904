"""The ready-made thermostat, neuron and converter with their derivatives by hand, as functions that numba compiles.

Parameters are in the order of the package's fields. Row k of x is the derivative by parameter k - 1.
"""

import numpy as np

from .numba_hybrid import Definition


def thermostat() -> Definition:
    """Parameters rate outside heating low high start; x = (temperature, J); mode[0] is 1 while it heats."""

    def start(p, x, mode):
        x[0, 0] = p[5]
        if len(x) > 1:
            x[6, 0] = 1.0

    def field(t, x, p, mode, rate):
        on = mode[0]
        for k in range(x.shape[0]):
            rate[k, 0], rate[k, 1] = -p[0] * x[k, 0], 0.0
        rate[0, 0] += p[0] * p[1] + on * p[2]
        rate[0, 1] = on * p[2]
        if len(x) > 1:
            rate[1, 0] += p[1] - x[0, 0]
            rate[2, 0] += p[0]
            rate[3, 0] += on
            rate[3, 1] = on

    def guard(t, x, rate, p, mode):
        return (p[4] - x[0, 0], -rate[0, 0]) if mode[0] else (x[0, 0] - p[3], rate[0, 0])

    def guard_row(t, x, p, mode, k):
        return (k == 5) - x[k, 0] if mode[0] else x[k, 0] - (k == 4)

    def known_time(p, mode):
        return np.inf

    def known_row(p, mode, k):
        return 0.0

    def reset(timed, x, p, mode):
        mode[0] = 1 - mode[0]

    return Definition(2, 6, start, field, guard, guard_row, known_time, known_row, reset)


def neuron(inputs: int) -> Definition:
    """Parameters: weight, weights and times of the inputs, drive, both time constants, threshold; x = (i, v, J);
    mode[0] counts the inputs."""
    m, drive = inputs, 1 + 2 * inputs

    def start(p, x, mode):
        pass

    def field(t, x, p, mode, rate):
        slow, fast = p[drive + 1], p[drive + 2]
        for k in range(x.shape[0]):
            rate[k, 0] = -x[k, 0] / fast
            rate[k, 1] = (x[k, 0] - x[k, 1]) / slow
            rate[k, 2] = 2 * x[0, 1] * x[k, 1]
        rate[0, 1] += p[drive] / slow
        rate[0, 2] = x[0, 1] ** 2
        if len(x) > 1:
            rate[drive + 1, 1] += 1 / slow
            rate[drive + 2, 1] -= rate[0, 1] / slow
            rate[drive + 3, 0] -= rate[0, 0] / fast

    def guard(t, x, rate, p, mode):
        return p[drive + 3] - x[0, 1], -rate[0, 1]

    def guard_row(t, x, p, mode, k):
        return (k == drive + 4) - x[k, 1]

    def known_time(p, mode):
        return p[1 + m + mode[0]] if mode[0] < m else np.inf

    def known_row(p, mode, k):
        return 1.0 * (k == 2 + m + mode[0])

    def reset(timed, x, p, mode):
        gained = 1 + mode[0] if timed else 0
        x[0, 0] += p[gained]
        if len(x) > 1:
            x[1 + gained, 0] += 1.0
        if timed:
            mode[0] += 1
        else:
            x[:, 1] = 0.0

    return Definition(3, 1 + 2 * inputs + 4, start, field, guard, guard_row, known_time, known_row, reset)


def converter() -> Definition:
    """Parameters source inductance capacitance load period duty gain reference voltage; x = (i, v, J); the mode is
    (carrier, cycle)."""

    def start(p, x, mode):
        x[0, 1] = p[8]
        if len(x) > 1:
            x[9, 1] = 1.0

    def field(t, x, p, mode, rate):
        on, conducts = 1.0 * (mode[0] == 0), 1.0 * (mode[0] != 2)
        for k in range(x.shape[0]):
            rate[k, 0] = -conducts * x[k, 1] / p[1]
            rate[k, 1] = (x[k, 0] - x[k, 1] / p[3]) / p[2]
            rate[k, 2] = on * p[0] * x[k, 0]
        rate[0, 0] += on * p[0] / p[1]
        if len(x) > 1:
            rate[1, 0] += on / p[1]
            rate[1, 2] += on * x[0, 0]
            rate[2, 0] -= rate[0, 0] / p[1]
            rate[3, 1] -= rate[0, 1] / p[2]
            rate[4, 1] += x[0, 1] / (p[3] * p[3] * p[2])

    def guard(t, x, rate, p, mode):
        if mode[0] == 0:
            return p[5] + p[6] * (p[7] - x[0, 1]) - (t / p[4] - mode[1]), -p[6] * rate[0, 1] - 1 / p[4]
        return (x[0, 0], rate[0, 0]) if mode[0] == 1 else (1.0, 0.0)

    def guard_row(t, x, p, mode, k):
        if mode[0] == 1:
            return x[k, 0]
        ramp = t / (p[4] * p[4]) * (k == 5)
        return ramp + (k == 6) + (p[7] - x[0, 1]) * (k == 7) + p[6] * (k == 8) - p[6] * x[k, 1]

    def known_time(p, mode):
        return (mode[1] + 1) * p[4]

    def known_row(p, mode, k):
        return (mode[1] + 1.0) * (k == 5)

    def reset(timed, x, p, mode):
        if timed:
            mode[0], mode[1] = 0, mode[1] + 1
            return
        mode[0] += 1
        if mode[0] == 2:
            x[:, 0] = 0.0

    return Definition(3, 9, start, field, guard, guard_row, known_time, known_row, reset)
