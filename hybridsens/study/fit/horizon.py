"""Long or wild motions: how to come near the minimum before the full problem is tried.

Over a long horizon the loss has many local minima: a guess whose phase is half a period off at the end sees the wrong
one. A short horizon has few, but leaves some parameters undetermined, so these stages hold z near the guess.
"""

from collections.abc import Iterator

import equinox as eqx
import jax.numpy as jnp

from .problem import Problem


class GrowingHorizon(eqx.Module):
    """Fit the beginning first, then longer and longer parts; each stage starts where the one before ended.

    Use it when the guess loses the phase within the horizon. Stages with about one more impact each serve well.
    """

    fractions: tuple[float, ...] = eqx.field(static=True, default=(0.15, 0.3, 0.45, 0.6, 0.8))
    """Parts of the horizon, increasing; the full problem follows them."""
    iterations: int = eqx.field(static=True, default=10)
    """At most so many in each stage: none has to converge."""
    anchor_weight: float = eqx.field(static=True, default=20.0)
    """How firmly stages hold z near the guess, in residuals (sigmas) per unit of z (a factor e of a positive
    parameter)."""

    def __check_init__(self):
        steps = (0.0, *self.fractions, 1.0)
        if not self.fractions or any(b <= a for a, b in zip(steps, steps[1:], strict=False)):
            raise ValueError(f"`fractions` must increase strictly inside (0, 1), but are {self.fractions}.")

    def stages(self, problem: Problem, z) -> Iterator[tuple[str, Problem]]:
        """Name and problem of every stage before the full one; all have one structure, so they compile once."""
        for fraction in self.fractions:
            yield f"horizon {fraction:g}", self.stage(problem, z, fraction)

    def stage(self, problem: Problem, z, fraction) -> Problem:
        """The problem on a part of the horizon, held near z."""
        horizon = problem.t0 + fraction * (problem.horizon - problem.t0)
        weight = jnp.asarray(self.anchor_weight, z.dtype) * problem.sigma_unit
        where = lambda p: (p.horizon, p.prior.anchor, p.prior.anchor_weight)
        return eqx.tree_at(where, problem, (horizon, z, weight))
