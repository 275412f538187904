"""A step-down converter with pulse-width modulation, whose diode may stop conducting before the period ends."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter

SWITCH, DIODE, NONE = 0, 1, 2
"""What carries the current of the inductor: `mode["carrier"]`."""


class BuckConverter(ShippedSystem):
    """L i' = source - v, -v or 0 while the switch, the diode or nothing carries i; C v' = i - v / R.

    Units are V, A, ohm, µH, µF and µs, which fit together. The switch closes at every tick of a clock and opens where
    the ramp t / period - cycle rises to the duty, `duty + gain (reference - v)`. Where i falls to 0 the diode stops.
    The mode is {"carrier": `SWITCH`, `DIODE` or `NONE`, "cycle": ticks so far}. J is the energy that was drawn [µJ]."""

    t1 = 56.0
    event_names = ("switch opens", "diode stops", "clock ticks")

    source: Float[Array, ""] = parameter(12.0)
    """[V]"""
    inductance: Float[Array, ""] = parameter(10.0)
    """L [µH]"""
    capacitance: Float[Array, ""] = parameter(22.0)
    """C [µF]"""
    load: Float[Array, ""] = parameter(20.0)
    """R [ohm]"""
    period: Float[Array, ""] = parameter(10.0)
    """Of the clock [µs]."""
    duty: Float[Array, ""] = parameter(0.25)
    """Of the period, at the reference voltage."""
    gain: Float[Array, ""] = parameter(0.1)
    """How the duty answers to the voltage [1/V]."""
    reference: Float[Array, ""] = parameter(5.0)
    """[V]"""
    voltage: Float[Array, ""] = parameter(4.5)
    """Initial voltage of the capacitor [V]; the current starts at 0, with a closed switch."""

    def initial_state(self):
        return {"i": jnp.zeros_like(self.voltage), "v": self.voltage}

    def initial_mode(self):
        return {"carrier": jnp.array(SWITCH), "cycle": jnp.array(0)}

    def running_cost(self, t, x, mode):
        return jnp.where(mode["carrier"] == SWITCH, self.source * x["i"], 0.0)

    def flow(self, t, x, mode):
        across = jnp.where(mode["carrier"] == SWITCH, self.source, 0.0) - x["v"]
        di = jnp.where(mode["carrier"] == NONE, 0.0, across) / self.inductance
        return {"i": di, "v": (x["i"] - x["v"] / self.load) / self.capacitance}

    def guards(self, t, x, mode):
        """The switch opens; the diode stops."""
        ramp = t / self.period - mode["cycle"]
        above = self.duty + self.gain * (self.reference - x["v"]) - ramp
        opens = jnp.where(mode["carrier"] == SWITCH, above, 1.0)
        stops = jnp.where(mode["carrier"] == DIODE, x["i"], 1.0)
        return jnp.stack([opens, stops])

    def scheduled_times(self, x, mode):
        """The clock ticks."""
        return ((mode["cycle"] + 1) * self.period)[None]

    def transition(self, event, t, x, mode):
        carrier = jnp.array([DIODE, NONE, SWITCH])[event]
        i = jnp.where(event == 1, 0.0, x["i"])
        return {**x, "i": i}, {"carrier": carrier, "cycle": mode["cycle"] + (event == 2)}
