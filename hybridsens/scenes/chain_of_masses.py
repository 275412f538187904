"""A row of masses on springs of their own that knock into each other, and into a wall at the end of the row."""

import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import line, rectangle
from .shipped import ShippedScene, parameter, scalars


class ChainOfMasses(ShippedScene):
    """q = displacements; forces -k_i q_i - c v_i + A cos(Omega t + 0.7 i); gaps of neighbours, and of the last one
    and the wall."""

    t1 = 20.0

    mass: Float[Array, "dof"]
    """[kg]"""
    stiffness: Float[Array, "dof"]
    """Of each mass's own spring [N/m]."""
    clearance: Float[Array, ""] = parameter(0.6)
    """Distance of neighbours, and of the last one and the wall, at rest [m]."""
    amplitude: Float[Array, ""] = parameter(1.0)
    """Of the force [N]."""
    damping: Float[Array, ""] = parameter(0.1)
    """[N s/m]"""
    frequency: Float[Array, ""] = parameter(1.3)
    """Angular frequency of the force [1/s]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.8)
    """e, in [0, 1]"""

    def __init__(self, count: int = 4, clearance=0.6, amplitude=1.0, restitution_coefficient=0.8):
        place = jnp.arange(float(count))
        self.mass, self.stiffness = 1 + 0.1 * jnp.sin(place), jnp.ones(count)
        self.clearance, self.amplitude, self.damping, self.frequency = scalars(clearance, amplitude, 0.1, 1.3)
        (self.restitution_coefficient,) = scalars(restitution_coefficient)

    @property
    def coordinates(self):  # type: ignore[override]
        """Names of the entries of q."""
        return tuple(f"mass {i} [m]" for i in range(self.mass.shape[0]))

    def draw(self, q):
        """Outlines of the wall, and of blocks that are half as wide as the clearance."""
        d, each = self.clearance, np.arange(q.shape[0])
        left, wall = q + 1.5 * d * each, 1.5 * d * q.shape[0]
        blocks = [rectangle([x, d / 20], [x + d / 2, d / 2]) for x in left]
        return [line([-d, 0.0], [wall, 0.0], [wall, d]), *blocks]

    def initial_state(self):
        return State(jnp.zeros_like(self.mass), jnp.zeros_like(self.mass))

    def mass_matrix(self, q):
        return lx.DiagonalLinearOperator(self.mass)

    def force(self, t, q, v):
        phase = 0.7 * np.arange(q.shape[0])  # cos(Omega t + phase), with two cosines in all
        push = np.cos(phase) * jnp.cos(self.frequency * t) - np.sin(phase) * jnp.sin(self.frequency * t)
        return self.amplitude * push - self.stiffness * q - self.damping * v

    def gap(self, t, q):
        return jnp.diff(q, append=0.0) + self.clearance

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, self.mass.shape)
