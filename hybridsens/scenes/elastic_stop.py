"""A forced oscillator that strikes an elastic stop: the kind of example that the method was first shown on."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import line, rectangle
from .shipped import ShippedScene, parameter


class ElasticStop(ShippedScene):
    """m q'' = -k q - c q' + A cos(Omega t), gap d - q, from rest at 0."""

    sustained_contact = False
    t1 = 20.0
    coordinates = ("displacement [m]",)

    mass: Float[Array, ""] = parameter(1.0)
    """[kg]"""
    stiffness: Float[Array, ""] = parameter(1.0)
    """k [N/m]"""
    damping: Float[Array, ""] = parameter(0.1)
    """c [N s/m]"""
    amplitude: Float[Array, ""] = parameter(1.0)
    """A [N]"""
    frequency: Float[Array, ""] = parameter(1.3)
    """Omega [rad/s]"""
    distance: Float[Array, ""] = parameter(0.6)
    """d, from the rest position to the stop [m]."""
    restitution_coefficient: Float[Array, ""] = parameter(1.0)
    """e, in [0, 1]"""

    def draw(self, q):
        """Outlines of the ground, of the stop, and of a block whose right side is at q."""
        d = self.distance
        return [line([-2 * d, 0.0], [d, 0.0], [d, d / 2]), rectangle([q[0] - d / 3, d / 20], [q[0], d / 3])]

    def initial_state(self):
        return State(jnp.zeros(1), jnp.zeros(1))

    def mass_matrix(self, q):
        return self.mass * jnp.eye(1)

    def force(self, t, q, v):
        return -self.stiffness * q - self.damping * v + self.amplitude * jnp.cos(self.frequency * t)

    def gap(self, t, q):
        return self.distance - q

    def restitution(self):
        return self.restitution_coefficient[None]
