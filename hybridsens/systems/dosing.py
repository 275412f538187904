"""A drug that is taken at given times, absorbed and eliminated."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter


class Dosing(ShippedSystem):
    """gut' = -absorption gut and blood' = absorption gut - elimination blood, amounts in mg; time is in hours.

    At `times[k]` the gut gains `doses[k]`, so the dose as well as its time can be designed. J is the integral of
    (blood - target)^2."""

    t1 = 24.0

    times: Float[Array, "dose"] = parameter((1.0, 7.0, 13.0))
    """When doses are taken [h]; those before the start are not."""
    doses: Float[Array, "dose"] = parameter((100.0, 80.0, 60.0))
    """[mg]"""
    absorption: Float[Array, ""] = parameter(1.2)
    """From the gut to the blood [1/h]."""
    elimination: Float[Array, ""] = parameter(0.2)
    """From the blood [1/h]."""
    target: Float[Array, ""] = parameter(50.0)
    """What the blood should hold [mg]."""
    before: Float[Array, ""] = parameter(20.0)
    """What the blood holds at the start [mg]."""

    @property
    def event_names(self):  # type: ignore[override]
        return tuple(f"dose {k}" for k in range(self.times.shape[0]))

    def initial_state(self):
        return {"gut": jnp.zeros_like(self.before), "blood": self.before}

    def running_cost(self, t, x, mode):
        return (x["blood"] - self.target) ** 2

    def flow(self, t, x, mode):
        absorbed = self.absorption * x["gut"]
        return {"gut": -absorbed, "blood": absorbed - self.elimination * x["blood"]}

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return self.times

    def transition(self, event, t, x, mode):
        return {**x, "gut": x["gut"] + self.doses[event]}, mode
