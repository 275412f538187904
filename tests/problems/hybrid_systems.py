"""Hybrid systems that are not mechanical, written as a user would."""

import jax.numpy as jnp
from jax import Array

import hybridsens as hs


class Thermostat(hs.AbstractHybridSystem):
    """x' = a (outside - x), and + heat while the heater is on; it switches at `low` and at `high`."""

    a: Array
    outside: Array
    heat: Array
    low: Array
    high: Array

    def flow(self, t, x, mode):
        return {"inside": self.a * (self.outside - x["inside"]) + jnp.where(mode["on"], self.heat, 0)}

    def guards(self, t, x, mode):
        return jnp.where(mode["on"], self.high - x["inside"], x["inside"] - self.low)[None]

    def transition(self, event, t, x, mode):
        return x, {"on": ~mode["on"], "count": mode["count"] + 1}


class Neuron(hs.AbstractHybridSystem):
    """v' = (i - v) / tau; at v = 1 it is reset to 0 and the current grows by w."""

    tau: Array
    w: Array

    def flow(self, t, x, mode):
        return {"v": (x["i"] - x["v"]) / self.tau, "i": jnp.zeros_like(x["i"])}

    def guards(self, t, x, mode):
        return (1.0 - x["v"])[None]

    def transition(self, event, t, x, mode):
        return {"v": jnp.zeros_like(x["v"]), "i": x["i"] + self.w}, mode


class Ball(hs.AbstractHybridSystem):
    g: Array
    e: Array

    def flow(self, t, x, mode):
        return jnp.stack([x[1], -self.g])

    def guards(self, t, x, mode):
        return x[:1]

    def transition(self, event, t, x, mode):
        return jnp.stack([x[0], -self.e * x[1]]), mode


class Oscillator(hs.AbstractHybridSystem):
    """x'' = -w^2 x, with a section x = 0 that is only recorded, and counted in the mode."""

    w: Array

    def flow(self, t, x, mode):
        return jnp.stack([x[1], -(self.w**2) * x[0]])

    def guards(self, t, x, mode):
        return x[:1]

    def transition(self, event, t, x, mode):
        return x, mode + 1


class Dominoes(hs.AbstractHybridSystem):
    """x' = -speed; at x = 0 it goes back to `height` and takes y below 0, which at once puts y back and x up more."""

    speed: Array
    height: Array
    more: Array

    def flow(self, t, x, mode):
        return jnp.stack([-self.speed, 0.3 * x[0]])

    def guards(self, t, x, mode):
        return x

    def transition(self, event, t, x, mode):
        first = jnp.stack([self.height, x[1] - 9.0])
        second = jnp.stack([x[0] + self.more * t, jnp.ones(())])
        return jnp.where(event == 0, first, second), mode


class Lines(hs.AbstractHybridSystem):
    """x' = -1 past lines at `at`. Line i adds `kick[i]` to x."""

    at: Array
    kick: Array

    def flow(self, t, x, mode):
        return -jnp.ones(())

    def guards(self, t, x, mode):
        return x - self.at

    def transition(self, event, t, x, mode):
        return x + self.kick[event], mode


class Overflow(hs.AbstractHybridSystem):
    """A tank that is filled at the rate 1 - t: level h; mode 1 while it overflows, until the inflow ends at t = 1."""

    full: Array

    def flow(self, t, x, mode):
        return jnp.where(mode == 0, 1 - t, 0.0)

    def guards(self, t, x, mode):
        return jnp.where(mode == 0, self.full - x, 1 - t)[None]

    def transition(self, event, t, x, mode):
        return x, 1 - mode


class Decay(hs.AbstractHybridSystem):
    """x' = -k x, without events."""

    k: Array = 0.7  # type: ignore[assignment]

    def flow(self, t, x, mode):
        return -self.k * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


class Dosed(hs.AbstractHybridSystem):
    """x' = -k x^2, with a dose d at a known time."""

    k: Array
    time: Array
    dose: Array

    def flow(self, t, x, mode):
        return -self.k * x**2

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return self.time[None]

    def transition(self, event, t, x, mode):
        return x + self.dose, mode
