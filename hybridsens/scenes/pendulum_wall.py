"""A pendulum that swings against a wall."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import line, links
from .shipped import ShippedScene, parameter


class PendulumWall(ShippedScene):
    """(m l^2 + I) q'' = -m g l sin q - c q', gap wall - l sin q; q is the angle from hanging down."""

    t1 = 6.0
    coordinates = ("angle [rad]",)

    mass: Float[Array, ""] = parameter(1.0)
    """m [kg]"""
    rotor_inertia: Float[Array, ""] = parameter(0.05)
    """I, of the axle [kg m^2]."""
    length: Float[Array, ""] = parameter(1.0)
    """l [m]"""
    gravity: Float[Array, ""] = parameter(9.81)
    """[m/s^2]"""
    damping: Float[Array, ""] = parameter(0.02)
    """c [N m s]"""
    wall: Float[Array, ""] = parameter(0.2)
    """Distance of the wall from the axle [m]."""
    angle: Float[Array, ""] = parameter(-1.0)
    """Initial angle [rad]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.8)
    """e, in [0, 1]"""

    def draw(self, q):
        """Outlines of the wall and of the pendulum."""
        return [line([self.wall, 0.0], [self.wall, -1.2 * self.length]), links(q, self.length[None])]

    def initial_state(self):
        return State(self.angle[None], jnp.zeros(1))

    def mass_matrix(self, q):
        return (self.mass * self.length**2 + self.rotor_inertia) * jnp.eye(1)

    def force(self, t, q, v):
        return -self.mass * self.gravity * self.length * jnp.sin(q) - self.damping * v

    def gap(self, t, q):
        return self.wall - self.length * jnp.sin(q)

    def restitution(self):
        return self.restitution_coefficient[None]
