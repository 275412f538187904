"""Two balls fall in one vertical line: the light one, above, is thrown high by the heavy one's rebound."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import circle, line
from .shipped import ShippedScene, parameter


class StackedBalls(ShippedScene):
    """q = heights (low, high), gaps q_low and q_high - q_low - clearance."""

    t1 = 1.5
    coordinates = ("low [m]", "high [m]")

    mass_low: Float[Array, ""] = parameter(1.0)
    """[kg]"""
    mass_high: Float[Array, ""] = parameter(0.1)
    """[kg]"""
    weight_low: Float[Array, ""] = parameter(9.81)
    """[N]"""
    weight_high: Float[Array, ""] = parameter(0.981)
    """[N]"""
    height_low: Float[Array, ""] = parameter(1.0)
    """Initial height [m]."""
    height_high: Float[Array, ""] = parameter(1.3)
    """Initial height [m]."""
    clearance: Float[Array, ""] = parameter(0.0)
    """Distance of the balls' reference points when they touch [m]."""
    restitution_floor: Float[Array, ""] = parameter(0.9)
    """e between the lower ball and the floor, in [0, 1]"""
    restitution_balls: Float[Array, ""] = parameter(0.9)
    """e between the balls, in [0, 1]"""

    def draw(self, q):
        """Outlines of the floor and of balls of radii 0.1 and 0.05, the lower one with its lowest point at q_low."""
        places = (q[0] + 0.1, q[1] - self.clearance + 0.25)
        balls = [circle([0.0, height], radius) for height, radius in zip(places, (0.1, 0.05), strict=True)]
        return [line([-0.5, 0.0], [0.5, 0.0]), *balls]

    def initial_state(self):
        return State(jnp.stack([self.height_low, self.height_high]), jnp.zeros(2))

    def mass_matrix(self, q):
        return jnp.diag(jnp.stack([self.mass_low, self.mass_high]))

    def force(self, t, q, v):
        return -jnp.stack([self.weight_low, self.weight_high])

    def gap(self, t, q):
        return jnp.stack([q[0], q[1] - q[0] - self.clearance])

    def restitution(self):
        return jnp.stack([self.restitution_floor, self.restitution_balls])
