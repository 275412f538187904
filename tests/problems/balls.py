"""A ball above a floor at 0: the least scenes that have impacts."""

import jax.numpy as jnp
from jax import Array

import hybridsens as hs


class RestlessBall(hs.AbstractScene):
    """q'' = -weight, gap q: of unit mass, and never at rest, so that it is quick to compile."""

    sustained_contact = False
    weight: Array
    e: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e[None]


class Thrown(hs.AbstractScene):
    """A ball over a floor."""

    mass: Array
    coordinates = ("x1 [m]", "y1 [m]")

    def mass_matrix(self, q):
        return self.mass * jnp.eye(2)

    def force(self, t, q, v):
        return self.mass * jnp.array([0.0, -9.81])

    def gap(self, t, q):
        return q[1:]

    def restitution(self):
        return jnp.array([0.8])
