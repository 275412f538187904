"""A pendulum of n links beside a wall that every joint may hit: a dense mass matrix that depends on q."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..mechanics.scene import State
from ..planar import line, links
from .shipped import ShippedScene, parameter, scalars


class LinkPendulum(ShippedScene):
    """q = angles of the links from hanging down, a mass at the end of each; gaps: distance of these from the wall.

    M_ij = m_ij l_i l_j cos(q_i - q_j), where m_ij is all the mass that hangs on both links."""

    t1 = 3.0

    mass: Float[Array, "dof"]
    """At the end of each link [kg]."""
    length: Float[Array, "dof"]
    """[m]"""
    gravity: Float[Array, ""] = parameter(9.81)
    """[m/s^2]"""
    wall: Float[Array, ""] = parameter(0.5)
    """Distance of the wall from the axle [m]."""
    angle: Float[Array, ""] = parameter(-0.8)
    """At which the pendulum, stretched out, is let go [rad]."""
    restitution_coefficient: Float[Array, ""] = parameter(0.7)
    """e, in [0, 1]"""

    def __init__(self, count: int = 3, wall=0.5, angle=-0.8, restitution_coefficient=0.7):
        self.mass, self.length = jnp.ones(count), jnp.full(count, 2.0 / count)
        self.gravity, self.wall, self.angle = scalars(9.81, wall, angle)
        (self.restitution_coefficient,) = scalars(restitution_coefficient)

    @property
    def coordinates(self):  # type: ignore[override]
        """Names of the entries of q."""
        return tuple(f"link {i} [rad]" for i in range(self.mass.shape[0]))

    def draw(self, q):
        """Outlines of the wall and of all links."""
        return [line([self.wall, 0.0], [self.wall, -1.2 * self.length.sum()]), links(q, self.length)]

    def initial_state(self):
        return State(jnp.broadcast_to(self.angle, self.mass.shape), jnp.zeros_like(self.mass))

    def _coupling(self):
        """m_ij l_i l_j."""
        hanging = self._hanging()
        # Of two links the lower one's. Read by an index, the derivative would be a scatter in every stage.
        on_both = jnp.where(np.tri(hanging.shape[0], dtype=bool), hanging[:, None], hanging)
        return on_both * jnp.outer(self.length, self.length)

    def _hanging(self):
        """All the mass that hangs on each link."""
        return jnp.cumsum(self.mass[::-1])[::-1]

    # cos(a - b) = cos a cos b + sin a sin b: one sine and one cosine a link instead of one a pair of links.

    def mass_matrix(self, q):
        return self._coupling() * (jnp.outer(jnp.cos(q), jnp.cos(q)) + jnp.outer(jnp.sin(q), jnp.sin(q)))

    def force(self, t, q, v):
        coupling, sine, cosine = self._coupling(), jnp.sin(q), jnp.cos(q)
        centrifugal = sine * (coupling @ (cosine * v**2)) - cosine * (coupling @ (sine * v**2))
        return -centrifugal - self._hanging() * self.gravity * self.length * sine

    def gap(self, t, q):
        return self.wall - jnp.cumsum(self.length * jnp.sin(q))

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, self.mass.shape)
