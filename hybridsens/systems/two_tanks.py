"""Two tanks in a row: a pump fills the first until the second is full enough, and the first may spill."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter


class TwoTanks(ShippedSystem):
    """upper' = inflow - drain_upper upper, lower' = drain_upper upper - drain_lower lower: levels [m], time in minutes.

    The pump goes on where the lower level falls to `low` and off where it rises to `high`. Where the upper level comes
    to `rim`, what the drain does not take spills until the pump goes off. The mode is {"pump", "spills"}. J is what
    was spilled [m]."""

    t1 = 12.0
    event_names = ("pump", "rim")

    inflow: Float[Array, ""] = parameter(1.5)
    """By the pump [m/min]."""
    drain_upper: Float[Array, ""] = parameter(0.8)
    """From the upper to the lower tank [1/min]."""
    drain_lower: Float[Array, ""] = parameter(0.5)
    """From the lower tank [1/min]."""
    rim: Float[Array, ""] = parameter(1.4)
    """Height of the upper tank [m]; below `inflow / drain_upper`, or it never spills."""
    low: Float[Array, ""] = parameter(0.6)
    """Lower level at which the pump goes on [m]."""
    high: Float[Array, ""] = parameter(1.5)
    """Lower level at which it goes off [m]."""
    upper: Float[Array, ""] = parameter(0.5)
    """Initial upper level [m]."""
    lower: Float[Array, ""] = parameter(0.8)
    """Initial lower level [m], with the pump on."""

    def initial_state(self):
        return {"upper": self.upper, "lower": self.lower}

    def initial_mode(self):
        return {"pump": jnp.array(True), "spills": jnp.array(False)}

    def running_cost(self, t, x, mode):
        return jnp.where(mode["spills"], self.inflow - self.drain_upper * x["upper"], 0.0)

    def flow(self, t, x, mode):
        passed = self.drain_upper * x["upper"]
        upper = jnp.where(mode["spills"], 0.0, jnp.where(mode["pump"], self.inflow, 0.0) - passed)
        return {"upper": upper, "lower": passed - self.drain_lower * x["lower"]}

    def guards(self, t, x, mode):
        """The pump switches; the upper tank is full."""
        switches = jnp.where(mode["pump"], self.high - x["lower"], x["lower"] - self.low)
        return jnp.stack([switches, jnp.where(mode["spills"], 1.0, self.rim - x["upper"])])

    def transition(self, event, t, x, mode):
        """At the rim the level is that of the rim, for as long as it spills."""
        upper = jnp.where(event == 0, x["upper"], self.rim)
        return {**x, "upper": upper}, {"pump": mode["pump"] ^ (event == 0), "spills": event == 1}
