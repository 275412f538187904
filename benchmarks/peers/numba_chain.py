"""The chain of masses by hand, compiled by numba: Tsit5, steps that end on impacts, the adjoint of the recorded steps.

Parameters p = (m_1 .. m_n, k_1 .. k_n, clearance, amplitude, e). State y = (q, v, J), J' = q.q. It knows that a contact
joins neighbours, that impacts come one by one and that none lasts: what compiled code for this one scene takes.
"""

import importlib.util
from typing import NamedTuple

import numpy as np
from diffrax import Tsit5

if importlib.util.find_spec("numba") is not None:
    from numba import njit

    fast = njit(error_model="numpy", fastmath={"contract", "nsz", "arcp"})
else:
    fast = lambda function: function

DAMPING, FREQUENCY, PHASE, HORIZON = 0.1, 1.3, 0.7, 20.0
TABLEAU = Tsit5().tableau
A = np.zeros((6, 6))
for _row, _weights in enumerate(TABLEAU.a_lower[:5]):
    A[_row + 1, : _row + 1] = _weights
B, C, E = np.array(TABLEAU.b_sol[:6]), np.array([0.0, *TABLEAU.c[:5]]), np.array(TABLEAU.b_error)
(A10,), (A20, A21), (A30, A31, A32) = A[1, :1], A[2, :2], A[3, :3]
(A40, A41, A42, A43), (A50, A51, A52, A53, A54) = A[4, :4], A[5, :5]
B0, B1, B2, B3, B4, B5 = B
E0, E1, E2, E3, E4, E5, E6 = E


class Record(NamedTuple):
    """Room for the accepted steps and the states before impacts."""

    t: np.ndarray
    y: np.ndarray
    contact: np.ndarray
    """Which contact a step ends on; -1 for none."""
    before: np.ndarray

    @staticmethod
    def of(n: int, steps: int, events: int) -> "Record":
        return Record(np.zeros(steps), np.zeros((steps, 2 * n + 1)), np.full(steps, -1), np.zeros((events, 2 * n + 1)))


@fast
def field(t, y, p, cosine, sine, out):
    n = cosine.size
    c, s, J = p[2 * n + 1] * np.cos(FREQUENCY * t), p[2 * n + 1] * np.sin(FREQUENCY * t), 0.0
    for i in range(n):
        out[i] = y[n + i]
        out[n + i] = (c * cosine[i] - s * sine[i] - p[n + i] * y[i] - DAMPING * y[n + i]) / p[i]
        J += y[i] * y[i]
    out[2 * n] = J


@fast
def step(t, h, y, p, cosine, sine, k, out):
    """From y and its rate k[0] to `out`, whose rate is k[6]."""
    k0, k1, k2, k3, k4, k5 = k[0], k[1], k[2], k[3], k[4], k[5]
    for i in range(y.size):
        out[i] = y[i] + h * A10 * k0[i]
    field(t + C[1] * h, out, p, cosine, sine, k1)
    for i in range(y.size):
        out[i] = y[i] + h * (A20 * k0[i] + A21 * k1[i])
    field(t + C[2] * h, out, p, cosine, sine, k2)
    for i in range(y.size):
        out[i] = y[i] + h * (A30 * k0[i] + A31 * k1[i] + A32 * k2[i])
    field(t + C[3] * h, out, p, cosine, sine, k3)
    for i in range(y.size):
        out[i] = y[i] + h * (A40 * k0[i] + A41 * k1[i] + A42 * k2[i] + A43 * k3[i])
    field(t + C[4] * h, out, p, cosine, sine, k4)
    for i in range(y.size):
        out[i] = y[i] + h * (A50 * k0[i] + A51 * k1[i] + A52 * k2[i] + A53 * k3[i] + A54 * k4[i])
    field(t + h, out, p, cosine, sine, k5)
    for i in range(y.size):
        out[i] = y[i] + h * (B0 * k0[i] + B1 * k1[i] + B2 * k2[i] + B3 * k3[i] + B4 * k4[i] + B5 * k5[i])
    field(t + h, out, p, cosine, sine, k[6])


@fast
def error_of(h, y, new, k, tolerance):
    total = 0.0
    for i in range(y.size):
        e = E0 * k[0, i] + E1 * k[1, i] + E2 * k[2, i] + E3 * k[3, i] + E4 * k[4, i] + E5 * k[5, i] + E6 * k[6, i]
        total += (h * e / (tolerance + tolerance * max(abs(y[i]), abs(new[i])))) ** 2
    return np.sqrt(total / y.size)


@fast
def gap(i, y, p, n):
    """Gap i and its rate."""
    q, v = (y[i + 1], y[n + i + 1]) if i < n - 1 else (0.0, 0.0)
    return q - y[i] + p[2 * n], v - y[n + i]


@fast
def fraction(g0, d0, g1, d1):
    """Where the cubic of a gap through both ends of a step first falls through 0, in fractions of it; 2 for nowhere."""
    if g1 >= 0 and (d0 >= 0 or d1 <= 0):
        return 2.0
    a, b, end = 3 * (g1 - g0) - 2 * d0 - d1, d0 + d1 - 2 * (g1 - g0), 1.0
    if g1 >= 0:  # a dip, with its lowest place at a root of the rate
        inside = a * a - 3 * b * d0
        end = -d0 / (a + np.sqrt(inside)) if inside >= 0 else 2.0
        if not 0 < end < 1 or g0 + end * (d0 + end * (a + end * b)) >= 0:
            return 2.0
    low, s = 0.0, 0.5 * end
    for _ in range(60):
        value, slope = g0 + s * (d0 + s * (a + s * b)), d0 + s * (2 * a + s * 3 * b)
        low, end = (s, end) if value > 0 else (low, s)
        new = s - value / slope if slope != 0 else 0.5 * (low + end)
        new = new if low < new < end else 0.5 * (low + end)
        if abs(new - s) < 1e-15:
            break
        s = new
    return s


@fast
def first_to_fall(h, old, new, p, n, known):
    """The contact whose gap falls first in a step, and where; `known` is one that may stand at 0 up to rounding."""
    best, who = 2.0, -1
    for i in range(n):
        (g0, d0), (g1, d1) = gap(i, old, p, n), gap(i, new, p, n)
        if i == known and abs(g1) <= 1e-14:
            continue
        s = fraction(max(g0, 0.0), h * d0, g1, h * d1)
        if s < best:
            best, who = s, i
    return who, best


@fast
def impact(i, y, p, n):
    m, (_, rate) = p[i], gap(i, y, p, n)
    reduced = m * p[i + 1] / (m + p[i + 1]) if i < n - 1 else m
    P = -(1 + p[2 * n + 2]) * reduced * rate
    y[n + i] -= P / m
    if i < n - 1:
        y[n + i + 1] += P / p[i + 1]


@fast
def forward(p, cosine, sine, tolerance, record):
    """J, accepted steps, steps tried, impacts."""
    n = cosine.size
    y, new, k = np.zeros(2 * n + 1), np.empty(2 * n + 1), np.empty((7, 2 * n + 1))
    t, h, count, tried, events = 0.0, 1e-3, 0, 0, 0
    field(t, y, p, cosine, sine, k[0])
    record.t[0], record.y[0] = t, y
    while t < HORIZON and count < record.t.size - 1:
        h = min(h, HORIZON - t)
        step(t, h, y, p, cosine, sine, k, new)
        tried += 1
        error = error_of(h, y, new, k, tolerance)
        longer = h * min(10.0, max(0.2, 0.9 * max(error, 1e-12) ** -0.2))
        if error > 1:
            h = longer
            continue
        struck = -1
        for _ in range(40):  # until the step ends on the first contact that falls in it
            who, s = first_to_fall(h, y, new, p, n, struck)
            if who < 0 and struck < 0:
                break
            value, rate = gap(struck if who < 0 else who, new, p, n)
            near = who < 0 or (who == struck and rate < 0 and abs(value) < 1e-3)
            struck = struck if who < 0 else who
            landed = h - value / rate if near else s * h
            if abs(value) <= 1e-14 or landed == h:
                break
            h = landed
            step(t, h, y, p, cosine, sine, k, new)
            tried += 1
        t, count = t + h, count + 1
        if struck >= 0:
            record.before[events] = new
            impact(struck, new, p, n)
            field(t, new, p, cosine, sine, k[6])
            events += 1
        y[:], k[0], h = new, k[6], longer
        record.t[count], record.y[count], record.contact[count] = t, y, struck
    return y[2 * n], count, tried, events
