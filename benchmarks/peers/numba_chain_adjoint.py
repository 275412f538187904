"""The way back over the steps that `numba_chain` records, with the jump of the adjoint at each impact."""

import numpy as np

from .numba_chain import DAMPING, FREQUENCY, PHASE, A, B, C, Record, fast, field, forward, gap


@fast
def accelerate(i, t, y, p, cosine, sine):
    """v_i' at (t, y)."""
    n = cosine.size
    push = p[2 * n + 1] * (np.cos(FREQUENCY * t) * cosine[i] - np.sin(FREQUENCY * t) * sine[i])
    return (push - p[n + i] * y[i] - DAMPING * y[n + i]) / p[i]


@fast
def jump_back(i, t, before, after, p, cosine, sine, psi, grad):
    """psi- of psi+ at an impact of contact i: v+ = v- -+ P / m, P = -(1 + e) mu r, at the time where the gap is 0."""
    n, e = cosine.size, p[p.size - 1]
    pair, m = i < n - 1, p[i]
    other = p[i + 1] if pair else np.inf
    mu = m * other / (m + other) if pair else m
    _, rate = gap(i, before, p, n)
    P = -(1 + e) * mu * rate
    old, old_other = psi[n + i], psi[n + i + 1] if pair else 0.0
    by_P = old_other / other - old / m
    by_rate = -by_P * (1 + e) * mu
    grad[p.size - 1] -= by_P * mu * rate
    by_mu = -by_P * (1 + e) * rate
    grad[i] += by_mu * (mu / m) ** 2 + old * P / m**2
    psi[n + i] -= by_rate
    if pair:
        grad[i + 1] += by_mu * (mu / other) ** 2 - old_other * P / other**2
        psi[n + i + 1] += by_rate
    late = psi[i] * (before[n + i] - after[n + i])  # what an impact that comes later changes
    late += psi[n + i] * accelerate(i, t, before, p, cosine, sine) - old * accelerate(i, t, after, p, cosine, sine)
    if pair:
        late += psi[i + 1] * (before[n + i + 1] - after[n + i + 1])
        late += psi[n + i + 1] * accelerate(i + 1, t, before, p, cosine, sine)
        late -= old_other * accelerate(i + 1, t, after, p, cosine, sine)
    by_gap = -late / rate
    grad[2 * n] += by_gap
    psi[i] -= by_gap
    if pair:
        psi[i + 1] += by_gap


@fast
def step_back(t, h, y, p, cosine, sine, psi, grad, k, stages, bars):
    """psi at the start of a step of psi at its end; the stages are computed again."""
    n = cosine.size
    for s in range(6):
        stages[s] = y
        for j in range(s):
            for i in range(2 * n):
                stages[s, i] += h * A[s, j] * k[j, i]
        field(t + C[s] * h, stages[s], p, cosine, sine, k[s])
    for s in range(5, -1, -1):
        c, d, by_push = np.cos(FREQUENCY * (t + C[s] * h)), np.sin(FREQUENCY * (t + C[s] * h)), 0.0
        for i in range(n):
            by_q, by_v = B[s] * psi[i], B[s] * psi[n + i]
            for j in range(s + 1, 6):
                by_q += A[j, s] * bars[j, i]
                by_v += A[j, s] * bars[j, n + i]
            by_v *= h / p[i]
            bars[s, i] = 2 * stages[s, i] * h * B[s] - p[n + i] * by_v
            bars[s, n + i] = h * by_q - DAMPING * by_v
            grad[n + i] -= stages[s, i] * by_v
            grad[i] -= k[s, n + i] * by_v
            by_push += (c * cosine[i] - d * sine[i]) * by_v
        grad[2 * n + 1] += by_push
    for s in range(6):
        for i in range(2 * n):
            psi[i] += bars[s, i]


@fast
def backward(p, cosine, sine, record, count, events):
    """dJ/dp."""
    n = cosine.size
    psi, grad = np.zeros(2 * n), np.zeros(p.size)
    k, stages, bars = np.empty((6, 2 * n + 1)), np.empty((6, 2 * n + 1)), np.empty((6, 2 * n))
    for j in range(count, 0, -1):
        if record.contact[j] >= 0:
            events -= 1
            given = record.before[events], record.y[j]
            jump_back(record.contact[j], record.t[j], *given, p, cosine, sine, psi, grad)
        t = record.t[j - 1]
        step_back(t, record.t[j] - t, record.y[j - 1], p, cosine, sine, psi, grad, k, stages, bars)
    return grad


class Chain:
    """Value and gradient of int q.q for `hybridsens.scenes.ChainOfMasses(n)`."""

    def __init__(self, n: int, tolerance: float = 1e-8):
        place = np.arange(n)
        self.parameters = np.concatenate([1 + 0.1 * np.sin(place), np.ones(n), [0.6, 1.0, 0.8]])
        self._waves = np.cos(PHASE * place), np.sin(PHASE * place)
        self._tolerance, self._record = tolerance, Record.of(n, 100 * n + 2000, 20 * n + 50)

    def value(self, p=None):
        """J, accepted steps, steps tried, impacts."""
        return forward(self.parameters if p is None else p, *self._waves, self._tolerance, self._record)

    def gradient(self):
        """J and dJ/dp."""
        J, count, _, events = self.value()
        return J, backward(self.parameters, *self._waves, self._record, count, events)
