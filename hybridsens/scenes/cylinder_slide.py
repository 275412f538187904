"""A point mass slides off a cylinder, flies, and bounces on the floor: sustained contact and its release."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import circle, line
from .shipped import ShippedScene, parameter


class CylinderSlide(ShippedScene):
    """q = (x, y), weight downward, gaps |q| - R and y + depth. From rest at `angle` from the top, it lets go where
    cos(theta) = (2/3) cos(angle)."""

    t1 = 2.5
    coordinates = ("x [m]", "y [m]")

    radius: Float[Array, ""] = parameter(1.0)
    """R [m]"""
    angle: Float[Array, ""] = parameter(0.1)
    """Initial angle from the top [rad]."""
    mass: Float[Array, ""] = parameter(1.0)
    """[kg]"""
    weight: Float[Array, ""] = parameter(9.81)
    """[N]"""
    depth: Float[Array, ""] = parameter(1.0)
    """How far the floor lies below the cylinder's axis [m]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.5)
    """Of the floor; the cylinder has the same."""

    def draw(self, q):
        """Outlines of the cylinder, of the floor and of the mass, as a small circle around its place."""
        floor = line([-self.radius, -self.depth], [4 * self.radius, -self.depth])
        return [circle([0.0, 0.0], self.radius), floor, circle(q, 0.03 * self.radius)]

    def initial_state(self):
        return State(self.radius * jnp.stack([jnp.sin(self.angle), jnp.cos(self.angle)]), jnp.zeros(2))

    def mass_matrix(self, q):
        return self.mass * jnp.eye(2)

    def force(self, t, q, v):
        return jnp.stack([jnp.zeros_like(self.weight), -self.weight])

    def gap(self, t, q):
        return jnp.stack([jnp.sqrt(q @ q) - self.radius, q[1] + self.depth])

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, (2,))
