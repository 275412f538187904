"""P1, P2, P2b and P4 in CasADi's symbols.

Each function takes time and parameters and returns state, its rate, the running cost or `None`, the gaps, the
state after an impact on each gap, the initial state and the horizon.
"""

import importlib.util

if importlib.util.find_spec("casadi") is not None:
    import casadi as ca


def _bouncing_ball(t, p):
    q, v = x = ca.SX.sym("q"), ca.SX.sym("v")
    return x, (v, -p[2]), q**2, [q], [(q, -p[3] * v)], (p[0], p[1]), 2.0


def _elastic_stop(t, p):
    omega, zeta, amplitude, forcing, d, e = ca.vertsplit(p)
    q, v = x = ca.SX.sym("q"), ca.SX.sym("v")
    acceleration = -(omega**2) * q - 2 * zeta * omega * v + amplitude * ca.cos(forcing * t)
    return x, (v, acceleration), q**2, [d - q], [(q, -e * v)], (0, 0), 20.0


def _two_balls(t, p):
    """No running cost: the functional is q2(T), entry 1 of the final state."""
    m1, m2, e1, e2, g = ca.vertsplit(p)
    q1, q2, v1, v2 = x = [ca.SX.sym(name) for name in ("q1", "q2", "v1", "v2")]
    impulse = (1 + e2) * (v1 - v2) * m1 * m2 / (m1 + m2)
    after = [(q1, q2, -e1 * v1, v2), (q1, q2, v1 - impulse / m1, v2 + impulse / m2)]
    return x, (v1, v2, -g, -g), None, [q1, q2 - q1], after, (1.0, 1.3, 0, 0), 1.5


PROBLEMS = {"P1": _bouncing_ball, "P2": _elastic_stop, "P2b": _elastic_stop, "P4": _two_balls}
