"""A wheel of spokes without a rim that rolls down a slope: the simplest walker."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter


class RimlessWheel(ShippedSystem):
    """length angle'' = gravity sin(angle), the angle of the standing spoke from the vertical, positive downhill.

    Where it comes to `slope + half`, the next spoke strikes without slip or rebound: the angle becomes
    `slope - half`, and the rate loses the factor cos(2 half). Rolling uphill, the same the other way round. On a steep
    slope its steps approach a limit cycle with rate^2 = c^2 / (1 - c^2) 4 gravity / length sin(half) sin(slope) just
    after a strike, c = cos(2 half). The mode counts the steps downhill. J is the integral of rate^2."""

    t1 = 2.5
    event_names = ("step down", "step up")

    length: Float[Array, ""] = parameter(1.0)
    """Of a spoke [m]."""
    gravity: Float[Array, ""] = parameter(9.81)
    """[m/s^2]"""
    half: Float[Array, ""] = parameter(0.4)
    """Half of the angle between two spokes [rad]."""
    slope: Float[Array, ""] = parameter(0.15)
    """Of the ground, downhill [rad]."""
    rate: Float[Array, ""] = parameter(1.4)
    """Initial rate [rad/s]; the wheel starts just after a strike."""

    def initial_state(self):
        return {"angle": self.slope - self.half, "rate": self.rate}

    def initial_mode(self):
        return jnp.array(0)

    def running_cost(self, t, x, mode):
        return x["rate"] ** 2

    def flow(self, t, x, mode):
        return {"angle": x["rate"], "rate": self.gravity / self.length * jnp.sin(x["angle"])}

    def guards(self, t, x, mode):
        """The spoke downhill strikes; the spoke uphill strikes."""
        return jnp.stack([self.slope + self.half - x["angle"], x["angle"] - (self.slope - self.half)])

    def transition(self, event, t, x, mode):
        side = jnp.where(event == 0, -1, 1)
        angle = self.slope + side * self.half
        return {"angle": angle, "rate": jnp.cos(2 * self.half) * x["rate"]}, mode - side
