"""Newton's cradle: equal balls on threads in a row, which hand an impact on from one end to the other."""

import jax.numpy as jnp
import lineax as lx
import numpy as np
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import circle
from .shipped import ShippedScene, parameter, scalars


class NewtonsCradle(ShippedScene):
    """q = displacements of the balls along the row, on long threads; gaps of neighbours.

    With a clearance of 0 all balls touch, and the law of simultaneous impacts acts, in which those that were struck
    move on together."""

    t1 = 6.0

    mass: Float[Array, "dof"]
    """[kg]"""
    clearance: Float[Array, ""] = parameter(1e-3)
    """Of neighbours at rest [m]."""
    gravity: Float[Array, ""] = parameter(9.81)
    """[m/s^2]"""
    length: Float[Array, ""] = parameter(9.81)
    """Of the threads [m]."""
    pulled: Float[Array, ""] = parameter(0.5)
    """How far the first ball is pulled aside [m]."""
    restitution_coefficient: Float[Array, ""] = parameter(1.0)
    """e, in [0, 1]"""

    def __init__(self, count: int = 5, clearance=1e-3, pulled=0.5, restitution_coefficient=1.0):
        self.mass = jnp.ones(count)
        self.clearance, self.pulled, self.gravity, self.length = scalars(clearance, pulled, 9.81, 9.81)
        (self.restitution_coefficient,) = scalars(restitution_coefficient)

    @property
    def coordinates(self):  # type: ignore[override]
        """Names of the entries of q."""
        return tuple(f"ball {i} [m]" for i in range(self.mass.shape[0]))

    def draw(self, q):
        """Outlines of the balls, of radius 0.1, which their threads lift by q^2 / (2 l)."""
        x = q + (0.2 + self.clearance) * np.arange(q.shape[0])
        return [circle(place, 0.1) for place in zip(x, q**2 / (2 * self.length), strict=True)]

    def initial_state(self):
        rest = jnp.zeros_like(self.mass)
        return State(rest.at[0].set(-self.pulled), rest)

    def mass_matrix(self, q):
        return lx.DiagonalLinearOperator(self.mass)

    def force(self, t, q, v):
        return -self.mass * self.gravity / self.length * q

    def gap(self, t, q):
        return jnp.diff(q) + self.clearance

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, (self.mass.shape[0] - 1,))
