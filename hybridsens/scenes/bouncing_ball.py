"""A ball dropped on a floor."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import circle, line
from .shipped import ShippedScene, parameter


class BouncingBall(ShippedScene):
    """m q'' = -weight, gap q - floor. With e < 1 the impacts accumulate at t_1 (1 + e) / (1 - e), then the ball
    rests."""

    t1 = 2.0
    coordinates = ("height [m]",)

    height: Float[Array, ""] = parameter(1.0)
    """Initial height [m]."""
    velocity: Float[Array, ""] = parameter(0.0)
    """Initial velocity, upward [m/s]."""
    mass: Float[Array, ""] = parameter(1.0)
    """[kg]"""
    weight: Float[Array, ""] = parameter(9.81)
    """[N]"""
    floor: Float[Array, ""] = parameter(0.0)
    """Height of the floor [m]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.8)
    """e, in [0, 1]"""

    def draw(self, q):
        """Outlines of the floor and of a ball of radius 0.05 whose lowest point is at q."""
        return [line([-0.5, self.floor], [0.5, self.floor]), circle([0.0, q[0] + 0.05], 0.05)]

    def initial_state(self):
        return State(self.height[None], self.velocity[None])

    def mass_matrix(self, q):
        return self.mass * jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return q - self.floor

    def restitution(self):
        return self.restitution_coefficient[None]
