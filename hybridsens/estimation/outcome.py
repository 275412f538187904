"""What one iteration of any optimizer tells."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .problem import Trial


class Outcome(NamedTuple):
    """One iteration."""

    z: Float[Array, "unknown"]
    """Where the optimizer stands after it."""
    loss: Float[Array, ""]
    """sum r^2 / 2 there."""
    gradient_norm: Float[Array, ""]
    """|dloss/dz| there."""
    accepted: Bool[Array, ""]
    """Whether the trial point was taken."""
    converged: Bool[Array, ""]
    stalled: Bool[Array, ""]
    """No trial point has been taken for several iterations."""
    first: Bool[Array, ""]
    """It is the first evaluation of a problem, so there was nothing to take a step from."""
    trial: Trial
    """What happened at the trial point."""

    @property
    def in_stage(self) -> Bool[Array, ""] | np.bool_:
        """Whether a shorter horizon than the problem's was fitted."""
        return self.trial.end < jnp.inf

    @property
    def ends(self) -> Bool[Array, ""] | np.bool_:
        """Whether the optimizer has nothing left to do: it is done or stuck, or has no motion to begin with."""
        return self.converged | self.stalled | (self.first & self.trial.failed)
