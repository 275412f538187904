"""Balls that fly about in a box, and hit its walls and each other."""

import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import circle
from .shipped import ShippedScene, parameter, scalars


class BallsInBox(ShippedScene):
    """q = (x_0, y_0, x_1, y_1, ...); gaps: n (n - 1) / 2 pairs of balls, then 4 n of a ball and a wall.

    `mass` may be given, one number for each of the `count` balls. Raises: ValueError for another number of them."""

    t1 = 2.0

    mass: Float[Array, "ball"]
    """[kg]"""
    radius: Float[Array, ""] = parameter(0.1)
    """[m]"""
    side: Float[Array, ""] = parameter(4.0)
    """Of the box, whose middle is the origin [m]."""
    gravity: Float[Array, ""] = parameter(0.0)
    """[m/s^2]"""
    speed: Float[Array, ""] = parameter(1.0)
    """Of every ball at the start [m/s]."""
    restitution_coefficient: Float[Array, ""] = parameter(1.0)
    """e, in [0, 1]"""

    def __init__(
        self, count: int = 3, radius=0.1, side=4.0, speed=1.0, gravity=0.0, restitution_coefficient=1.0, mass=None
    ):
        self.mass = 1 + 0.2 * jnp.cos(jnp.arange(float(count))) if mass is None else jnp.asarray(mass, float)
        if self.mass.shape != (count,):
            raise ValueError(f"`mass` must have a number for each of {count} balls, but has shape {self.mass.shape}.")
        self.radius, self.side, self.speed, self.gravity = scalars(radius, side, speed, gravity)
        (self.restitution_coefficient,) = scalars(restitution_coefficient)

    @property
    def coordinates(self):  # type: ignore[override]
        """Names of the entries of q."""
        return tuple(f"{axis}{i} [m]" for i in range(self.mass.shape[0]) for axis in "xy")

    @property
    def contacts(self):  # type: ignore[override]
        """Names of the gaps, in their order."""
        balls = range(self.mass.shape[0])
        pairs = (f"balls {i}-{j}" for i in balls for j in balls[i + 1 :])
        walls = (f"ball {i} {wall}" for two in (("left", "bottom"), ("right", "top")) for i in balls for wall in two)
        return *pairs, *walls

    def draw(self, q):
        """Outlines of the box and of the balls, for `hybridsens.animate`."""
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
        return [corners * self.side / 2, *(circle(place, self.radius) for place in q.reshape(-1, 2))]

    def initial_state(self):
        """On a square grid, in directions that no two share."""
        count = self.mass.shape[0]
        across = int(np.ceil(np.sqrt(count)))
        place, direction = np.arange(count), 2.4 * np.arange(count) + 0.3
        grid = np.stack([place % across, place // across], axis=1) + 0.5
        q = self.side * (grid / across - 0.5)
        v = self.speed * np.stack([np.cos(direction), np.sin(direction)], axis=1)
        return State(q.ravel(), v.ravel())

    def mass_matrix(self, q):
        return lx.DiagonalLinearOperator(jnp.repeat(self.mass, 2))

    def force(self, t, q, v):
        return -self.gravity * jnp.stack([jnp.zeros_like(self.mass), self.mass], axis=1).ravel()

    def gap(self, t, q):
        places = q.reshape(-1, 2)
        one, other = np.triu_indices(places.shape[0], k=1)
        apart = places[one] - places[other]
        pairs = jnp.sqrt(apart[:, 0] ** 2 + apart[:, 1] ** 2) - 2 * self.radius
        reach = self.side / 2 - self.radius
        return jnp.concatenate([pairs, reach + q, reach - q])

    def restitution(self):
        count = self.mass.shape[0]
        return jnp.broadcast_to(self.restitution_coefficient, (count * (count - 1) // 2 + 4 * count,))
