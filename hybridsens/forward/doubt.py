"""Why the derivatives of a motion that reaches its end are not to be trusted, and when that happened."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..status import Status


class Doubt(NamedTuple):
    """The last reason, and its time."""

    why: Status
    """`Status.running` where derivatives are to be trusted."""
    time: Float[Array, ""]
    """nan there."""

    @classmethod
    def none(cls, t: Float[Array, ""]) -> "Doubt":
        """None, with a time of t's type."""
        return cls(Status.running, jnp.full_like(t, jnp.nan))

    def also(self, condition: Bool[Array, ""], why: Status, time) -> "Doubt":
        """This doubt, or where the condition holds a later one."""
        return Doubt(Status.where(condition, why, self.why), jnp.where(condition, time, self.time))
