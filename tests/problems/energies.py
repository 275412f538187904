"""Ready-made scenes written again, as energies: each must be the one that was written by hand."""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

import hybridsens as hs
from hybridsens.scenes import DoublePendulumWall, PendulumWall


def as_energies(energies, scene):
    """The scene of energies with the parameters of the hand-written one."""
    return energies(**{field.name: getattr(scene, field.name) for field in dataclasses.fields(scene)})


class DoublePendulumOfEnergies(hs.LagrangianScene):
    """`DoublePendulumWall`, from the places of its masses."""

    mass_upper: Float[Array, ""]
    mass_lower: Float[Array, ""]
    rotor_inertia: Float[Array, ""]
    length_upper: Float[Array, ""]
    length_lower: Float[Array, ""]
    gravity: Float[Array, ""]
    wall: Float[Array, ""]
    angle_upper: Float[Array, ""]
    angle_lower: Float[Array, ""]
    restitution_coefficient: Float[Array, ""]

    def initial_state(self):
        return hs.State(jnp.stack([self.angle_upper, self.angle_lower]), jnp.zeros(2))

    def elbow(self, q):
        return self.length_upper * jnp.stack([jnp.sin(q[0]), -jnp.cos(q[0])])

    def tip(self, q):
        return self.elbow(q) + self.length_lower * jnp.stack([jnp.sin(q[1]), -jnp.cos(q[1])])

    def kinetic_energy(self, q, v):
        elbow, tip = hs.planar.velocity(self.elbow, q, v), hs.planar.velocity(self.tip, q, v)
        return 0.5 * (self.mass_upper * elbow @ elbow + self.mass_lower * tip @ tip + self.rotor_inertia * v[0] ** 2)

    def potential_energy(self, q):
        return self.gravity * (self.mass_upper * self.elbow(q)[1] + self.mass_lower * self.tip(q)[1])

    def gap(self, t, q):
        points = jnp.stack([self.elbow(q), self.tip(q)])
        left = jnp.array([-1.0, 0.0])
        return hs.planar.to_half_plane(points, -self.wall * left, left)

    def restitution(self):
        return jnp.broadcast_to(self.restitution_coefficient, (2,))


class PendulumOfEnergies(hs.LagrangianScene):
    """`PendulumWall`, with its damping as Rayleigh's function."""

    mass: Float[Array, ""]
    rotor_inertia: Float[Array, ""]
    length: Float[Array, ""]
    gravity: Float[Array, ""]
    damping: Float[Array, ""]
    wall: Float[Array, ""]
    angle: Float[Array, ""]
    restitution_coefficient: Float[Array, ""]

    def initial_state(self):
        return hs.State(self.angle[None], jnp.zeros(1))

    def kinetic_energy(self, q, v):
        return 0.5 * (self.mass * self.length**2 + self.rotor_inertia) * v @ v

    def potential_energy(self, q):
        return -self.mass * self.gravity * self.length * jnp.sum(jnp.cos(q))

    def dissipation(self, q, v):
        return 0.5 * self.damping * v @ v

    def gap(self, t, q):
        return self.wall - self.length * jnp.sin(q)

    def restitution(self):
        return self.restitution_coefficient[None]


PAIRS = [(DoublePendulumWall, DoublePendulumOfEnergies), (PendulumWall, PendulumOfEnergies)]
