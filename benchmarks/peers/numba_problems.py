"""Flow, gap and start of P1, P2 and P2b with their derivatives by hand, as plain functions that numba compiles.

The state and its derivatives by every parameter are rows of one array x: x[0] = (q, v, J), J the integral of
q^2, and x[1 + k] = d(q, v, J)/dp[k]; a solve without derivatives has the first row alone. The last parameter is the
coefficient of restitution.
"""

import numpy as np


def bouncing_ball():
    """P1, parameters q0 v0 g e."""

    def start(p, x):
        x[0, 0], x[0, 1] = p[0], p[1]
        if len(x) > 1:
            x[1, 0] = x[2, 1] = 1.0

    def field(t, x, p, rate):
        for k in range(x.shape[0]):
            rate[k, 0], rate[k, 1], rate[k, 2] = x[k, 1], 0.0, 2 * x[0, 0] * x[k, 0]
        rate[0, 1], rate[0, 2] = -p[2], x[0, 0] ** 2
        if len(x) > 1:
            rate[3, 1] = -1.0

    def gap(x, p):
        """Gap, its rate, its derivative by q, and the index of the parameter it grows with (none: -1)."""
        return x[0, 0], x[0, 1], 1.0, -1

    return start, field, gap, 4


def elastic_stop():
    """P2 and P2b, parameters omega zeta A Omega d e."""

    def start(p, x):
        pass

    def field(t, x, p, rate):
        omega, zeta, amplitude = p[0], p[1], p[2]
        cosine, sine = np.cos(p[3] * t), np.sin(p[3] * t)
        q, v = x[0, 0], x[0, 1]
        for k in range(x.shape[0]):
            rate[k, 0] = x[k, 1]
            rate[k, 1] = -(omega**2) * x[k, 0] - 2 * zeta * omega * x[k, 1]
            rate[k, 2] = 2 * q * x[k, 0]
        rate[0, 1] += amplitude * cosine
        rate[0, 2] = q * q
        if len(x) > 1:
            rate[1, 1] -= 2 * omega * q + 2 * zeta * v
            rate[2, 1] -= 2 * omega * v
            rate[3, 1] += cosine
            rate[4, 1] -= amplitude * t * sine

    def gap(x, p):
        return p[4] - x[0, 0], -x[0, 1], -1.0, 4

    return start, field, gap, 6


# Each with its horizon.
PROBLEMS = {"P1": (bouncing_ball, 2.0), "P2": (elastic_stop, 20.0), "P2b": (elastic_stop, 20.0)}
