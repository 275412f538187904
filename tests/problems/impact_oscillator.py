"""A chaotic impact oscillator, and its motion in long arithmetic.

q'' = -q + A cos(Omega t) above a stop at -d, e = 0.95: flights are known in closed form, so that an event is the root
of a known function, and the state's derivative is a product of known saltation matrices.
"""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np

import hybridsens as hs

AMPLITUDE, PACE, DISTANCE, E = 1.0, 2.5, 0.2, 0.95


class ImpactOscillator(hs.AbstractScene):
    """q'' = -q + A cos(Omega t), gap q + d."""

    amplitude: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -q + self.amplitude * jnp.cos(PACE * t)

    def gap(self, t, q):
        return q + DISTANCE

    def restitution(self):
        return self.e[None]


@jax.jit
def grow(q0, t1, tolerance):
    """Growth of the initial state's variations, by the package."""
    scene = ImpactOscillator(jnp.array(AMPLITUDE), jnp.array(E))
    state = hs.State(q0[None], jnp.zeros(1))
    settings = dict(rtol=tolerance, atol=tolerance, max_events=512, max_steps=16384, throw=False)
    return hs.lyapunov(scene, state, t1=t1, **settings)


def reference(q0: float, t1: float, digits: int = 60):
    """State and d state / d (q0, v0) at t1, and the number of impacts, in long arithmetic."""
    with mp.workdps(digits):
        t, q, v = mp.mpf(0), mp.mpf(q0), mp.mpf(0)
        matrix, impacts = mp.eye(2), 0
        while True:
            hit = _first_impact(t, q, v, mp.mpf(t1))
            end = mp.mpf(t1) if hit is None else hit
            c, s = mp.cos(end - t), mp.sin(end - t)
            (q, v), matrix, t = _flow(t, q, v, end), mp.matrix([[c, s], [-s, c]]) * matrix, end
            if hit is None:
                return (float(q), float(v)), np.array(matrix.tolist(), float), impacts
            force = -q + AMPLITUDE * mp.cos(PACE * t)
            matrix = mp.matrix([[-E, 0], [(1 + mp.mpf(E)) * force / v, -E]]) * matrix
            q, v, impacts = -mp.mpf(DISTANCE), -E * v, impacts + 1


def _flow(t, q, v, end):
    forced = mp.mpf(AMPLITUDE) / (1 - mp.mpf(PACE) ** 2)
    free_q, free_v = q - forced * mp.cos(PACE * t), v + forced * PACE * mp.sin(PACE * t)
    c, s = mp.cos(end - t), mp.sin(end - t)
    return (
        free_q * c + free_v * s + forced * mp.cos(PACE * end),
        -free_q * s + free_v * c - forced * PACE * mp.sin(PACE * end),
    )


def _first_impact(t, q, v, t1, step=0.01):
    """First root of q + d after t: scanned in steps, then found to all digits."""
    left = t + mp.mpf("1e-4")
    while left < t1:
        right = left + step
        if _flow(t, q, v, right)[0] + DISTANCE < 0:
            root = mp.findroot(lambda s: _flow(t, q, v, s)[0] + DISTANCE, (left, right), solver="anderson")
            return root if root < t1 else None
        left = right
    return None
