"""A room that a thermostat heats: two modes, two thresholds."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter


class Thermostat(ShippedSystem):
    """x' = rate (outside - x) + heating while the heater is on; x is the temperature [°C], time is in hours.

    The heater goes on where x falls to `low` and off where it rises to `high`: that the thresholds are apart is what
    keeps it from chattering. The mode says whether it is on. J is what has been heated [K]."""

    t1 = 10.0

    rate: Float[Array, ""] = parameter(0.3)
    """Heat loss [1/h]."""
    outside: Float[Array, ""] = parameter(10.0)
    """Temperature outside [°C]."""
    heating: Float[Array, ""] = parameter(9.0)
    """What the heater adds [K/h]; `outside + heating / rate` must be above `high`."""
    low: Float[Array, ""] = parameter(18.0)
    """Where the heater goes on [°C]."""
    high: Float[Array, ""] = parameter(22.0)
    """Where it goes off [°C]."""
    start: Float[Array, ""] = parameter(20.0)
    """Initial temperature [°C], with the heater off."""

    def initial_state(self):
        return self.start

    def initial_mode(self):
        return jnp.array(False)

    def running_cost(self, t, x, mode):
        return jnp.where(mode, self.heating, 0.0)

    def flow(self, t, x, mode):
        return self.rate * (self.outside - x) + jnp.where(mode, self.heating, 0.0)

    def guards(self, t, x, mode):
        return jnp.where(mode, self.high - x, x - self.low)[None]

    def transition(self, event, t, x, mode):
        return x, ~mode
