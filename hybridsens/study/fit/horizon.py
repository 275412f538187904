"""Long or wild motions: how to come near the minimum before the full problem is tried.

Over a long horizon the loss has many local minima: a guess whose phase is half a period off at the end sees the wrong
one. A short horizon has few, but leaves some parameters undetermined, so these stages hold z near the guess.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .problem import Problem, predict


class GrowingHorizon(eqx.Module):
    """Fit the beginning first; after every step the horizon reaches as far as the motion follows the record.

    Use it when the guess loses the phase within the horizon. No stage is polished: with Levenberg-Marquardt one
    accepted step each is enough. Gradient descents (Adam, L-BFGS) want more `steps`, and so do chaotic motions, with a
    smaller `first` and `trust`.
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
        if not 0 < self.first < 1 or not self.growth > 1 or not self.trust > 0 or self.steps < 1:
            raise ValueError(
                "`first` must lie inside (0, 1), `growth` above 1, `trust` above 0 and `steps` at 1 or more, but they "
                f"are {self.first}, {self.growth}, {self.trust} and {self.steps}."
            )

    @property
    def trials(self) -> int:
        """Room for trial points at one horizon, most of them rejected if it is used up."""
        return self.steps + 8

    def next(self, problem: Problem, z, end) -> Float[Array, ""]:
        """Where the stage after one that ended at time `end` and at the unknowns z ends [s]; inf: it is the whole
        problem. `end` is -inf before the first stage."""
        none = jnp.isneginf(end)
        part, base = jnp.where(none, self.first, self.growth), jnp.where(none, problem.horizon, end)
        reached = self.reach(problem, predict(problem, z)[1], part, base)
        return jnp.where(reached < problem.horizon, reached, jnp.inf)

    def reach(self, problem: Problem, seen, part, end) -> Float[Array, ""]:
        """Time until which a motion follows the record: at the least this part of the time until `end`, at most the
        full horizon.

        It is lost at two samples in a row that are too far off: one alone may be an outlier.
        """
        times, least = problem.data.times, problem.t0 + part * (end - problem.t0)
        if times.size < 2:
            return jnp.minimum(least, problem.horizon)
        lost = self._lost(problem, seen)
        twice = lost[:-1] & lost[1:]
        last = jnp.where(jnp.any(twice), times[jnp.argmax(twice) - 1], problem.horizon)
        last = jnp.where(twice[0], problem.t0, last)
        return jnp.minimum(jnp.maximum(last, least), problem.horizon)

    def _lost(self, problem: Problem, seen) -> Bool[Array, "sample"]:
        data = problem.data
        known = data.weights > 0
        count = jnp.sum(known, axis=0)
        mean = jnp.sum(known * data.values, axis=0) / count
        spread = jnp.sqrt(jnp.sum(known * (data.values - mean) ** 2, axis=0) / count)
        follows = jnp.abs(seen - data.values) <= self.trust * spread  # False for NaN, where a motion has failed
        return jnp.any(known & ~follows, axis=1)

    def stage(self, problem: Problem, anchor, end) -> Problem:
        """The problem up to the time `end`, held near z = `anchor`; with `end` at inf the problem itself."""
        weight = jnp.where(jnp.isinf(end), 0, self.anchor_weight * problem.sigma_unit)
        prior = dataclasses.replace(problem.prior, anchor=anchor, anchor_weight=weight.astype(anchor.dtype))
        horizon = jnp.minimum(end, problem.horizon).astype(problem.horizon.dtype)
        return dataclasses.replace(problem, horizon=horizon, prior=prior)
