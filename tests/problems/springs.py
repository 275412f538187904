"""A spring whose force jumps at a place, by a comparison and by a mode."""

import jax
import jax.numpy as jnp

import hybridsens

TOLERANCES = {"rtol": 1e-10, "atol": 1e-10}


class Spring(hybridsens.AbstractHybridSystem):
    """q'' = -k q, with another force where q is above a place."""

    located_discontinuities = True
    k: jax.Array
    force: jax.Array
    place: jax.Array

    def flow(self, t, x, mode):
        return {"q": x["v"], "v": -self.k * x["q"] + jnp.where(x["q"] > self.place, self.force, 0.0)}

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


class SpringInModes(Spring):
    """The same by a mode."""

    located_discontinuities = False

    def flow(self, t, x, mode):
        return {"q": x["v"], "v": -self.k * x["q"] + jnp.where(mode, self.force, 0.0)}

    def guards(self, t, x, mode):
        return jnp.where(mode, 1, -1) * (x["q"] - self.place)[None]

    def transition(self, event, t, x, mode):
        return x, ~mode


START = {"q": 1.0, "v": 0.0}


def moved(system, mode=None, **options):
    return hybridsens.solve(system, START, mode, t1=4.0, **(TOLERANCES | options))
