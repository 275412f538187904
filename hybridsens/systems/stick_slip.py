"""A mass on a moving belt, held by a spring: it sticks, is carried along, tears loose and slips back."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .shipped import ShippedSystem, parameter

STICKS, SLOWER, FASTER = 0, -1, 1
"""The mode: the mass moves with the belt, slower or faster."""


class StickSlip(ShippedSystem):
    """m x'' = friction - k x - c x', with friction = sliding, -sliding where the mass is slower, faster than the belt.

    It sticks, x' = belt, for as long as the friction that this takes, k x + c belt, is within `holding`. Where it
    comes to the belt's speed, that decides whether it sticks or slips on to the other side. J is the belt's work [J].
    """

    t1 = 20.0

    mass: Float[Array, ""] = parameter(1.0)
    """m [kg]"""
    stiffness: Float[Array, ""] = parameter(1.0)
    """k [N/m]"""
    damping: Float[Array, ""] = parameter(0.05)
    """c [N s/m]"""
    belt: Float[Array, ""] = parameter(0.3)
    """Speed of the belt [m/s]."""
    holding: Float[Array, ""] = parameter(1.0)
    """Largest friction while it sticks [N], at least `sliding`."""
    sliding: Float[Array, ""] = parameter(0.6)
    """Friction while it slips [N]."""
    start: Float[Array, ""] = parameter(0.2)
    """Initial place [m]; it starts on the belt."""

    def initial_state(self):
        return {"x": self.start, "v": self.belt}

    def initial_mode(self):
        return jnp.array(STICKS)

    def running_cost(self, t, x, mode):
        return self.belt * jnp.where(mode == STICKS, self._pull(x["x"]), -mode * self.sliding)

    def _pull(self, x):
        """Friction that it takes to keep the mass on the belt."""
        return self.stiffness * x + self.damping * self.belt

    def flow(self, t, x, mode):
        force = -mode * self.sliding - self.stiffness * x["x"] - self.damping * x["v"]
        return {"x": x["v"], "v": jnp.where(mode == STICKS, 0.0, force / self.mass)}

    def guards(self, t, x, mode):
        """It tears loose backward, or comes to the belt's speed; it tears loose forward."""
        pull, ahead = self._pull(x["x"]), x["v"] - self.belt
        first = jnp.where(mode == STICKS, self.holding - pull, mode * ahead)
        return jnp.stack([first, jnp.where(mode == STICKS, self.holding + pull, 1.0)])

    def transition(self, event, t, x, mode):
        loose = jnp.where(event == 0, SLOWER, FASTER)
        pull = self._pull(x["x"])
        side = jnp.where(pull > 0, SLOWER, FASTER)
        arrived = jnp.where(jnp.abs(pull) < self.holding, STICKS, side)
        return {**x, "v": self.belt}, jnp.where(mode == STICKS, loose, arrived)
