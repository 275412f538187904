"""A block that drops on n feet, onto an even floor or an uneven one: it rests on more feet than it needs."""

import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Float

from ..mechanics.scene import State
from .shipped import ShippedScene, parameter, scalars


class FootedBlock(ShippedScene):
    """q = (height, slope along x, slope along y); the feet stand in a circle around the middle; one gap for each foot.

    On an even floor n feet share the weight in more than one way; on an uneven one three of them carry it."""

    t1 = 2.0
    coordinates = ("height [m]", "slope along x [1]", "slope along y [1]")

    floor: Float[Array, "foot"]
    """Height of the floor below each foot [m]."""
    mass: Float[Array, ""] = parameter(1.0)
    """[kg]"""
    inertia: Float[Array, ""] = parameter(0.4)
    """About each axis [kg m^2]."""
    gravity: Float[Array, ""] = parameter(9.81)
    """[m/s^2]"""
    height: Float[Array, ""] = parameter(0.2)
    """Initial height of the feet above the even floor [m]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.0)
    """e, in [0, 1]"""

    def __init__(self, count: int = 4, unevenness=0.0, height=0.2, restitution_coefficient=0.0):
        self.floor = unevenness * jnp.cos(1.7 * jnp.arange(float(count)))
        self.mass, self.inertia, self.gravity, self.height = scalars(1.0, 0.4, 9.81, height)
        (self.restitution_coefficient,) = scalars(restitution_coefficient)

    def initial_state(self):
        return State(jnp.zeros(3).at[0].set(self.height), jnp.zeros(3))

    def mass_matrix(self, q):
        return lx.DiagonalLinearOperator(jnp.stack([self.mass, self.inertia, self.inertia]))

    def force(self, t, q, v):
        return jnp.zeros(3).at[0].set(-self.mass * self.gravity)

    def gap(self, t, q):
        around = 2 * np.pi * np.arange(self.floor.shape[0]) / self.floor.shape[0]
        return q[0] + np.cos(around) * q[1] + np.sin(around) * q[2] - self.floor

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, self.floor.shape)
