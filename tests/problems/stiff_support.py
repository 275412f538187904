"""A stiff support beside a hard stop, and its motion in long arithmetic.

A body x on a soft spring strikes a stop at 1. A support y follows it through a stiff damped spring and pulls weakly:
    x'' = -x + (y - x) / 5,    y'' = -ratio^2 (y - x) - 2 ratio (y' - x').
Everything between impacts is linear, so the truth is a matrix exponential in 40 digits.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np

import hybridsens as hs

HORIZON = 4.0
SPEED, E = 1.5, 0.7


class StiffSupport(hs.AbstractScene):
    """q = (x, y); gap stop - x."""

    ratio: jax.Array
    stop: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        follow = -(self.ratio**2) * (q[1] - q[0]) - 2 * self.ratio * (v[1] - v[0])
        return jnp.stack([-q[0] + (q[1] - q[0]) / 5, follow])

    def gap(self, t, q):
        return self.stop - q[:1]

    def restitution(self):
        return self.e[None]


@eqx.filter_jit
def solve(solver, ratio, tolerance):
    """x(T), its gradient by (speed, stop, e), and the motion."""

    def final(p):
        scene, state = StiffSupport(ratio, p[1], p[2]), hs.State(jnp.zeros(2), jnp.stack([p[0], p[0]]))
        motion = hs.simulate(
            scene, state, t1=HORIZON, solver=solver, rtol=tolerance, atol=tolerance, max_events=16, throw=False
        )
        return motion.final.q[0], motion

    return jax.value_and_grad(final, has_aux=True)(jnp.array([SPEED, 1.0, E]))


def reference(ratio: float, digits: int = 40):
    """x(T) and its gradient, by differences in long arithmetic."""
    with mp.workdps(digits):
        step = mp.mpf(10) ** -10
        points = [mp.mpf(SPEED), mp.mpf(1), mp.mpf(E)]
        gradient = []
        for k in range(3):
            ends = [_final([p + sign * step * (i == k) for i, p in enumerate(points)], ratio) for sign in (1, -1)]
            gradient.append(float((ends[0] - ends[1]) / (2 * step)))
        return float(_final(points, ratio)), np.array(gradient)


def _final(p, ratio):
    """x(T) for p = (speed, stop, e): the modes of the linear motion, and the roots of x = stop."""
    ratio = mp.mpf(ratio)
    rows = [[0, 0, 1, 0], [0, 0, 0, 1], [-1 - mp.mpf(1) / 5, mp.mpf(1) / 5, 0, 0]]
    matrix = mp.matrix([*rows, [ratio**2, -(ratio**2), 2 * ratio, -2 * ratio]])
    values, vectors = mp.eig(matrix)
    t, state = mp.mpf(0), mp.matrix([0, 0, p[0], p[0]])
    while True:
        weights = mp.lu_solve(vectors, state)

        def at(s, weights=weights):
            return vectors * mp.matrix([w * mp.exp(value * s) for w, value in zip(weights, values, strict=True)])

        hit = _first_hit(lambda s, at=at: mp.re(at(s)[0]) - p[1], mp.mpf(HORIZON) - t)
        if hit is None:
            return mp.re(at(HORIZON - t)[0])
        state = at(hit).apply(mp.re)
        state[2], t = -p[2] * state[2], t + hit


def _first_hit(gap, left_over):
    """First upward crossing after the start, found by scanning."""
    s = mp.mpf("1e-3")
    while s < left_over:
        if gap(s + mp.mpf("0.02")) > 0:
            return mp.findroot(gap, (s, s + mp.mpf("0.02")), solver="anderson")
        s += mp.mpf("0.02")
    return None
