"""Bodies without springs before flat contacts: balls in a row, and a plate on feet."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

import hybridsens as hs

GRAVITY = 9.81
FEET = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [1.0, -1.0, -1.0]])
TRIPOD = np.array([[1.0, 1.0, 0.0], [1.0, -0.5, 0.8], [1.0, -0.5, -0.8]])
TABLES = {
    "three feet": TRIPOD,
    "four feet": FEET,
    "a foot twice": np.vstack([TRIPOD, TRIPOD[:1]]),
    "a foot twice but for 1e-8": np.vstack([TRIPOD, TRIPOD[:1] + [0.0, 1e-8, 0.0]]),
}


class FlatContacts(hs.AbstractScene):
    """diag(mass) q'' = load, gaps normals q + offsets."""

    mass: Array
    load: Array
    normals: Array
    offsets: Array
    e: Array

    def mass_matrix(self, q):
        return jnp.diag(self.mass)

    def force(self, t, q, v):
        return self.load

    def gap(self, t, q):
        return self.normals @ q + self.offsets

    def restitution(self):
        return self.e


@eqx.filter_jit
def run(scene, q, v, t1, max_events=4096):
    """The motion from plain lists."""
    state = hs.State(jnp.array(q, float), jnp.array(v, float))
    return hs.simulate(scene, state, t1=t1, max_events=max_events, max_steps=4 * max_events, throw=False)


def make(mass, load, normals, offsets, e) -> FlatContacts:
    """A scene from plain lists."""
    return FlatContacts(*(jnp.array(part, float) for part in (mass, load, normals, offsets, e)))


def balls(count: int, e: float, mass=None) -> FlatContacts:
    """Balls of diameter 1 in a line, each gap between neighbours."""
    normals = np.eye(count - 1, count, 1) - np.eye(count - 1, count)
    masses = np.ones(count) if mass is None else mass
    return make(masses, np.zeros(count), normals, -np.ones(count - 1), [e] * (count - 1))


def plate(feet, e: float, floor: float = 0.0) -> FlatContacts:
    """A plate with coordinates (height, two tilts) on feet above a floor."""
    return make([1.0, 0.3, 0.4], [-GRAVITY, 0.0, 0.0], feet, [-floor] * len(feet), [e] * len(feet))
