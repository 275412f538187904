"""What one iteration of any optimizer tells."""

from typing import NamedTuple

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
    trial: Trial
    """What happened at the trial point."""
