"""The motion inside one step, as the cubic through its ends."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..interval.arithmetic import Interval, outward, point
from ..interval.jet import Jet
from ..numerics.tolerances import rounding

DOUBT = 3.0
"""Error of the cubic over what the solver's estimate of its own error makes one expect."""


class Path(NamedTuple):
    """q(s) = sum_k c_k s^k, t(s) = t0 + s h for s in [0, 1], through q and v at both ends of a step.

    It is exact for ballistic flight, at any length of the step; for other motions its error is O(h^4).
    """

    t0: Float[Array, ""]
    h: Float[Array, ""]
    coefficients: tuple[Float[Array, "dof"], ...]

    @classmethod
    def through(cls, t0, t1, q0, v0, q1, v1) -> "Path":
        """The path from (t0, q0, v0) to (t1, q1, v1)."""
        h = t1 - t0
        d0, d1, rise = h * v0, h * v1, q1 - q0
        return cls(t0, h, (q0, d0, 3 * rise - 2 * d0 - d1, d0 + d1 - 2 * rise))

    def at(self, s):
        """t, q and dq/ds at a fraction of the step."""
        c0, c1, c2, c3 = self.coefficients
        return self.t0 + s * self.h, c0 + s * (c1 + s * (c2 + s * c3)), c1 + s * (2 * c2 + 3 * s * c3)

    def over(self, s, width) -> tuple[Jet, Jet]:
        """Bounds of t and q and of their derivatives by s, from s to s + width: those of their control points."""
        _, q, slope = self.at(s)
        _, _, c2, c3 = self.coefficients
        bends = [2 * c2 + 6 * s * c3, 2 * c2 + 6 * (s + width) * c3]
        middle = slope + bends[0] * width / 2
        slopes = [slope, middle, middle + bends[1] * width / 2]
        q1 = q + slopes[0] * width / 3
        q2 = q1 + slopes[1] * width / 3
        t = Interval(self.t0 + s * self.h, self.t0 + (s + width) * self.h)
        positions = [q, q1, q2, q2 + slopes[2] * width / 3]
        return Jet(t, point(self.h), None), Jet(_span(positions), _span(slopes), _span(bends))

    def ways(self) -> Float[Array, "dof"]:
        """How far each coordinate goes, by its rate at the start and by where it ends."""
        return jnp.abs(self.coefficients[1]) + jnp.abs(sum(self.coefficients[1:]))

    def doubt(self, error: Float[Array, "dof"], order) -> Float[Array, ""]:
        """How far the cubic may be from the motion, as a fraction of what it travels; rounding in ballistic flight.

        Over a step in which a motion turns by an angle a, the solver's estimate of its error, relative to the way
        travelled, falls as a^(order - 1) and the error of the cubic as a^3: so one tells of the other.
        """
        travelled = jnp.max(self.ways())
        ratio = jnp.max(jnp.abs(error)) / jnp.where(travelled > 0, travelled, 1)
        return DOUBT * ratio ** min(3 / max(float(order) - 1, 1), 1.0) + rounding(error.dtype)


def _span(points) -> Interval:
    low, high = points[0], points[0]
    for other in points[1:]:
        low, high = jnp.minimum(low, other), jnp.maximum(high, other)
    return outward(low, high)
