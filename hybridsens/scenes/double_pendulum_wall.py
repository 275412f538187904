"""A double pendulum beside a wall that its elbow and its tip may hit: the mass matrix depends on the configuration."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import line, links
from .shipped import ShippedScene, parameter


class DoublePendulumWall(ShippedScene):
    """q = angles of both arms from hanging down; gaps: distance of elbow and tip from a vertical wall."""

    t1 = 3.0
    coordinates = ("upper angle [rad]", "lower angle [rad]")

    mass_upper: Float[Array, ""] = parameter(1.0)
    """At the elbow [kg]."""
    mass_lower: Float[Array, ""] = parameter(0.5)
    """At the tip [kg]."""
    rotor_inertia: Float[Array, ""] = parameter(0.02)
    """Of the axle [kg m^2]."""
    length_upper: Float[Array, ""] = parameter(1.0)
    """[m]"""
    length_lower: Float[Array, ""] = parameter(0.7)
    """[m]"""
    gravity: Float[Array, ""] = parameter(9.81)
    """[m/s^2]"""
    wall: Float[Array, ""] = parameter(0.5)
    """Distance of the wall from the axle [m]."""
    angle_upper: Float[Array, ""] = parameter(-0.8)
    """Initial angle [rad]."""
    angle_lower: Float[Array, ""] = parameter(-0.3)
    """Initial angle [rad]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.7)
    """e, in [0, 1]"""

    def draw(self, q):
        """Outlines of the wall and of both arms."""
        lengths = jnp.stack([self.length_upper, self.length_lower])
        return [line([self.wall, 0.0], [self.wall, -1.2 * lengths.sum()]), links(q, lengths)]

    def initial_state(self):
        return State(jnp.stack([self.angle_upper, self.angle_lower]), jnp.zeros(2))

    def mass_matrix(self, q):
        coupling = self.mass_lower * self.length_upper * self.length_lower * jnp.cos(q[0] - q[1])
        upper = (self.mass_upper + self.mass_lower) * self.length_upper**2 + self.rotor_inertia
        return jnp.array([[upper, coupling], [coupling, self.mass_lower * self.length_lower**2]])

    def force(self, t, q, v):
        coupling = self.mass_lower * self.length_upper * self.length_lower * jnp.sin(q[0] - q[1])
        upper = -coupling * v[1] ** 2 - (
            self.mass_upper + self.mass_lower
        ) * self.gravity * self.length_upper * jnp.sin(q[0])
        lower = coupling * v[0] ** 2 - self.mass_lower * self.gravity * self.length_lower * jnp.sin(q[1])
        return jnp.stack([upper, lower])

    def gap(self, t, q):
        elbow = self.length_upper * jnp.sin(q[0])
        return self.wall - jnp.stack([elbow, elbow + self.length_lower * jnp.sin(q[1])])

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, (2,))
