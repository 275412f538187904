"""A ball on a table that shakes hard enough to throw it: a gap that depends on time, with release and capture."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import circle, line
from .shipped import ShippedScene, parameter


class VibratingTable(ShippedScene):
    """m q'' = -weight, gap q - A sin(omega t). The ball starts on the table and moves with it until it is thrown."""

    t1 = 0.6
    coordinates = ("height [m]",)

    mass: Float[Array, ""] = parameter(1.0)
    """[kg]"""
    weight: Float[Array, ""] = parameter(9.81)
    """[N]"""
    amplitude: Float[Array, ""] = parameter(0.02)
    """A [m]"""
    frequency: Float[Array, ""] = parameter(31.41592653589793)
    """omega [rad/s]"""
    restitution_coefficient: Float[Array, ""] = parameter(0.1)
    """e, in [0, 1]"""

    def draw(self, q, t):
        """Outlines of the table and of a ball whose lowest point is at q."""
        height, radius = self.amplitude * np.sin(self.frequency * t), self.amplitude / 4
        table = line([-self.amplitude, height], [self.amplitude, height])
        return [table, circle([0.0, q[0] + radius], radius)]

    def initial_state(self):
        return State(jnp.zeros(1), (self.amplitude * self.frequency)[None])

    def running_cost(self, t, q, v):
        return (q[0] - self.amplitude * jnp.sin(self.frequency * t)) ** 2

    def mass_matrix(self, q):
        return self.mass * jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return q - self.amplitude * jnp.sin(self.frequency * t)

    def restitution(self):
        return self.restitution_coefficient[None]
