"""Long or wild motions: how to come near the minimum before the full problem is tried.

Over a long horizon the loss has many local minima: a guess whose phase is half a period off at the end sees the wrong
one. A short horizon has few, but leaves some parameters undetermined, so these stages hold z near the guess.
"""

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..validation.arguments import whole_number


class GrowingHorizon(eqx.Module):
    """Fit the beginning first; after every step the horizon reaches as far as the motion follows the record.

    Use it when the guess loses the phase within the horizon. No stage is polished: with Levenberg-Marquardt one
    accepted step each is enough. Gradient descents (Adam, L-BFGS) want more `steps`. Chaotic motions want
    `GrowingHorizon(first=0.1, trust=0.25, steps=3)`; docs/fitting.md has the records that each recovers.
    """

    first: float = eqx.field(static=True, default=0.2)
    """Part of the horizon to begin with."""
    growth: float = eqx.field(static=True, default=1.1)
    """Factor by which the horizon grows at least."""
    trust: float = eqx.field(static=True, default=1.0)
    """The motion follows the record while it is no farther from it than this many standard deviations of the record."""
    steps: int = eqx.field(static=True, default=1)
    """Accepted steps at each horizon."""
    anchor_weight: float = eqx.field(static=True, default=20.0)
    """How firmly stages hold z near the guess, in residuals (sigmas) per unit of z (a factor e of a positive
    parameter)."""

    def __check_init__(self):
        whole_number("`steps`", self.steps)
        if not 0 < self.first < 1 or not self.growth > 1 or not self.trust > 0:
            raise ValueError(
                "`first` must lie inside (0, 1), `growth` above 1 and `trust` above 0, but they are "
                f"{self.first}, {self.growth} and {self.trust}."
            )

    @property
    def trials(self) -> int:
        """Room for trial points at one horizon, most of them rejected if it is used up."""
        return self.steps + 8

    def next(self, problem, seen, end) -> Float[Array, ""]:
        """Where the stage after one that ended at time `end` ends [s], if a motion shows `seen`: at the last time until
        which it follows the record, at the least later by the factor `growth`; inf: it is the whole problem. `end` is
        -inf before the first stage.

        A motion is lost at two samples in a row that are too far off: one alone may be an outlier.
        """
        none, times, t0 = jnp.isneginf(end), problem.data.times, problem.t0
        least = t0 + jnp.where(none, self.first * (problem.horizon - t0), self.growth * (end - t0))
        if times.size > 1:
            lost = self._lost(problem, seen)
            twice = lost[:-1] & lost[1:]
            last = jnp.where(jnp.any(twice), times[jnp.argmax(twice) - 1], problem.horizon)
            least = jnp.maximum(jnp.where(twice[0], t0, last), least)
        return jnp.where(least < problem.horizon, least, jnp.inf)

    def _lost(self, problem, seen) -> Bool[Array, "sample"]:
        data = problem.data
        known = data.weights > 0
        count = jnp.sum(known, axis=0)
        mean = jnp.sum(known * data.values, axis=0) / count
        spread = jnp.sqrt(jnp.sum(known * (data.values - mean) ** 2, axis=0) / count)
        follows = jnp.abs(seen - data.values) <= self.trust * spread  # False for NaN, where a motion has failed
        return jnp.any(known & ~follows, axis=1)


class Stage(eqx.Module):
    """A part of a `FitProblem`: measurements until a time, and unknowns held near the guess."""

    growth: GrowingHorizon
    anchor: Float[Array, "parameter"]
    """The guess."""
    end: Float[Array, ""]
    """The last time; inf: the whole problem. If the stage has yet to begin, that of the stage before it."""
    begins: Bool[Array, ""]
    """The stage has yet to begin: one motion over the full horizon shows how far it follows the record."""

    def motion_end(self, problem) -> Float[Array, ""]:
        """How far motions go [s]."""
        return jnp.where(self.begins, problem.horizon, jnp.minimum(self.end, problem.horizon))

    def chosen_end(self, problem, seen) -> Float[Array, ""]:
        """The last time, chosen by what a motion shows if the stage has yet to begin."""
        following = self.growth.next(problem, lax.stop_gradient(seen), self.end)
        return jnp.where(self.begins, following, self.end)

    def anchor_residuals(self, problem, z, end) -> Float[Array, "parameter"]:
        """Residuals that hold z near the guess; 0 in the whole problem."""
        weight = self.growth.anchor_weight * problem.sigma_unit
        return jnp.where(jnp.isposinf(end), 0, (z - self.anchor) * weight)
