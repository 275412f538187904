"""What bounds prove of gaps along one stretch of a step."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..interval.arithmetic import Interval

FAR = 200
"""A gap that turns near zero bends so much that it would rise to FAR / 2 times the tolerance within the step. One that
bends less stays near zero, as where two bodies move along together."""


class Nearness(NamedTuple):
    """How near zero gaps can be told from gaps at zero."""

    rounding: Float[Array, "contact"]
    """What evaluating them leaves."""
    doubt: Float[Array, "contact"] | None
    """By how much the path through the step may be off, which a shorter step lessens; None where it is not asked how
    nearly a gap misses zero."""
    depth: Float[Array, "contact"]
    """How exactly the motion itself is known; below 0 for a gap that is not searched."""

    @property
    def tolerance(self) -> Float[Array, "contact"]:
        """Of this search."""
        return self.rounding if self.doubt is None else self.rounding + self.doubt

    @property
    def too_rough(self) -> Bool[Array, "contact"]:
        """Which gaps a shorter step would tell more of."""
        return self.tolerance - self.rounding > jnp.maximum(self.depth, self.rounding)

    @classmethod
    def roughly(cls, tolerance, searched: Bool[Array, "contact"]) -> "Nearness":
        """Where it is not asked how nearly a gap misses zero."""
        return cls(tolerance, None, jnp.where(searched, 0.0, -1))


class Turns(NamedTuple):
    """What is known of gaps that turn near zero along a stretch."""

    unclear: Bool[Array, ""]
    """Whether one may be as near as the tolerance or not."""
    rough: Bool[Array, ""]
    """Whether one is, and a shorter step would tell more."""
    touch: Bool[Array, ""]
    """Whether one is, and none would."""


class Stretch(NamedTuple):
    """What is known of the gaps along one stretch of a step; rates are by fractions of the step."""

    width: Float[Array, ""]
    gap0: Float[Array, "contact"]
    rate0: Float[Array, "contact"]
    gap1: Float[Array, "contact"]
    rate1: Float[Array, "contact"]
    low: Float[Array, "contact"]
    """Lower bounds of the gaps; not a number where there is none."""
    bend: Interval
    """Bounds of their second derivatives."""

    def least(self) -> Float[Array, "contact"]:
        """What gaps are proved to stay above: by their bounds, or by an end and the second derivative. Not a number
        where nothing is."""
        w = self.width
        curve = self.bend.low * w * w
        forward, backward = lowest(self.gap0, self.rate0 * w, curve), lowest(self.gap1, -self.rate1 * w, curve)
        return jnp.fmax(self.low, jnp.fmax(forward, backward))

    def falls(self, tolerance) -> Bool[Array, "contact"]:
        """Which gaps are proved to fall all along, to below -tolerance."""
        from_start = self.rate0 + jnp.maximum(self.bend.high, 0) * self.width < 0
        from_end = self.rate1 - jnp.minimum(self.bend.low, 0) * self.width < 0
        return (self.gap1 < -tolerance) & (from_start | from_end)

    def turns(self, least, nearness: Nearness) -> "Turns":
        """What is to be known of gaps that fall and rise again, without being proved to stay above the tolerance."""
        no, tolerance = jnp.array(False), nearness.tolerance
        if nearness.doubt is None:
            return Turns(no, no, no)
        turning = (nearness.depth >= 0) & (self.rate0 < 0) & (self.rate1 > 0) & ~(least > tolerance)

        def look():
            turns = turning & (self.bend.low > FAR * tolerance)
            # They bend up no more than by their bounds.
            near = turns & (lowest(self.gap0, self.rate0 * self.width, self.bend.high * self.width**2) <= tolerance)
            rough = nearness.too_rough
            return Turns(jnp.any(turns & ~near), jnp.any(near & rough), jnp.any(near & ~rough))

        return lax.cond(jnp.any(turning), look, lambda: Turns(no, no, no))  # there is hardly ever one

    def crossing(self, which: Bool[Array, "contact"]) -> Float[Array, ""]:
        """Where the first of these gaps passes zero, as a fraction of the stretch, by its chord."""
        return jnp.clip(jnp.min(jnp.where(which, self.gap0 / (self.gap0 - self.gap1), 1), initial=jnp.inf), 0, 1)


def lowest(gap, rate, curve):
    """Least value of gap + rate s + curve s^2 / 2 for s in [0, 1]: a gap that bends down no more lies above it."""
    inside = (curve > 0) & (rate < 0) & (rate + curve > 0)
    vertex = gap - 0.5 * rate * rate / jnp.where(inside, curve, 1)
    return jnp.where(inside, vertex, jnp.minimum(gap, gap + rate + 0.5 * curve))
