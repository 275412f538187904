"""A ball above a floor at 0: the least scene that has impacts."""

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
