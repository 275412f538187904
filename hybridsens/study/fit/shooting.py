"""Multiple shooting: the horizon is cut into windows, each with a free initial state, and penalties tie them
together."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from .descend import Descent, Room, descend
from .optimizers import Method
from .problem import Problem
from .watch import Audience
from .windows import cut


class MultipleShooting(eqx.Module):
    """Fit windows of the horizon side by side, tied together more firmly from stage to stage; then the full problem.

    Meant for motions that forget their start (chaos, many impacts). It works best when all coordinates are measured:
    then the windows start from the data; otherwise from the motion of the guess. Event times take no part in it.
    Free initial states do not help where the phase of a drive is unknown: there, and wherever a motion is not chaotic,
    take `GrowingHorizon`, which needs fewer and cheaper iterations; docs/fitting.md has the records that each recovers.
    """

    windows: int = eqx.field(static=True, default=4)
    continuity: tuple[float, ...] = eqx.field(static=True, default=(0.1, 1.0, 10.0, 100.0))
    """Weight of a jump between windows in each stage, in residuals per percent of the coordinate's size."""
    iterations: int = eqx.field(static=True, default=20)
    """At most so many in each stage."""

    def __check_init__(self):
        if self.windows < 2 or not self.continuity or min(self.continuity) <= 0:
            raise ValueError(
                "`windows` must be >= 2 and `continuity` must have positive weights, but they are "
                f"{self.windows} and {self.continuity}."
            )

    def run(self, how: Method, problem: Problem, z, audience: Audience) -> tuple[list[Descent], Array]:
        """All stages, and the parameters to go on with."""
        shooting, y = cut(problem, z, self.windows)
        done = []
        for weight in self.continuity:
            stage = eqx.tree_at(lambda s: s.weight, shooting, jnp.asarray(100 * weight, y.dtype) * problem.sigma_unit)
            done.append(descend(how, stage, y, Room(self.iterations, self.iterations), stage=f"continuity {weight:g}",
                                audience=audience))  # fmt: skip
            y = done[-1].z
            if done[-1].by_hand:
                break
        return done, y[: z.size]
