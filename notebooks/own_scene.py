# %% [markdown]
# # A scene of your own, from its energies
#
# A mass hangs on a spring, swings, and strikes a wall. In polar coordinates its equations have Coriolis and
# centrifugal terms, the likeliest place of a mistake. **Can we get them without deriving anything, and how do we know
# that they are right?**

# %%
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import hybridsens as hs

hs.configure()

# %% [markdown]
# ## Energies in, motion out
#
# Coordinates: the length $r$ of the spring and its angle $\theta$ from hanging down. The tip is at $(r\sin\theta,
# -r\cos\theta)$. Kinetic energy is that of the tip's velocity, potential energy that of the spring and of the weight;
# the gap is how far the tip is from the wall.


# %%
class SpringPendulum(hs.LagrangianScene):
    """A mass on a spring beside a wall, in polar coordinates."""

    mass: Array  # [kg]
    stiffness: Array  # [N/m]
    length: Array  # of the unloaded spring [m]
    wall: Array  # its distance from the pivot [m]
    e: Array  # coefficient of restitution

    coordinates = ("length [m]", "angle [rad]")
    contacts = ("wall",)

    def tip(self, q):
        return q[0] * jnp.stack([jnp.sin(q[1]), -jnp.cos(q[1])])

    def kinetic_energy(self, q, v):
        speed = hs.planar.velocity(self.tip, q, v)
        return 0.5 * self.mass * speed @ speed

    def potential_energy(self, q):
        return 0.5 * self.stiffness * (q[0] - self.length) ** 2 + 9.81 * self.mass * self.tip(q)[1]

    def gap(self, t, q):
        return (self.wall - self.tip(q)[0])[None]

    def restitution(self):
        return self.e[None]

    def draw(self, q):
        along, across = self.tip(q), q[0] * jnp.stack([jnp.cos(q[1]), jnp.sin(q[1])])
        place = jnp.linspace(0.1, 0.9, 33)[:, None]
        coil = place * along + 0.04 * jnp.sin(16 * jnp.pi * place) * across / q[0]
        spring = jnp.concatenate([jnp.zeros((1, 2)), coil, along[None]])
        wall = jnp.stack([jnp.stack([self.wall, -1.6]), jnp.stack([self.wall, 0.1])])
        return [spring, hs.planar.circle(along, 0.05), wall]


numbers = dict(mass=0.5, stiffness=60.0, length=1.0, wall=0.4, e=0.8)
scene = SpringPendulum(**{name: jnp.asarray(number) for name, number in numbers.items()})
start = hs.State([1.1, -0.9], [0.0, 0.0])
motion = hs.simulate(scene, start, t1=3.0, ts=jnp.linspace(0.0, 3.0, 601))
motion

# %%
hs.animate(scene, motion, frames_per_second=12, size=(3.2, 4))

# %%
hs.plot_coordinates(scene, motion)

# %% [markdown]
# ## Energy
#
# Nothing takes energy but the wall: between impacts it must stay what it is, and drop by $(1 - e^2)\,m w^2 / 2$ where
# the closing speed is $w$ (the wall takes of what comes straight at it).

# %%
energy = jax.vmap(scene.energy)(motion.q, motion.v)
count = int(motion.events.count)
taken = 0.5 * 0.5 * (1 - 0.8**2) * motion.events.closing_speed[:count] ** 2
print(f"energy at the start {energy[0]:.9f} J; taken by {count} impacts {jnp.sum(taken):.9f} J")
print(f"energy at the end   {energy[-1]:.9f} J; the sum of both {energy[-1] + jnp.sum(taken):.9f} J")
assert abs(energy[-1] + jnp.sum(taken) - energy[0]) < 1e-6

# %% [markdown]
# ## The same mass, described in another way
#
# A stronger test: in Cartesian coordinates the mass matrix is a constant and nothing is left to go wrong. The two
# descriptions share no equation of motion, and must move alike.


# %%
class Cartesian(hs.AbstractScene):
    """The same mass with q = (x, y)."""

    mass: Array
    stiffness: Array
    length: Array
    wall: Array
    e: Array

    def mass_matrix(self, q):
        return self.mass * jnp.eye(2)

    def force(self, t, q, v):
        r = jnp.sqrt(q @ q)
        return -self.stiffness * (r - self.length) * q / r - 9.81 * self.mass * jnp.array([0.0, 1.0])

    def gap(self, t, q):
        return (self.wall - q[0])[None]

    def restitution(self):
        return self.e[None]


def end(scene, start):
    motion = hs.simulate(scene, start, t1=3.0, rtol=1e-11, atol=1e-11)
    return (scene.tip(motion.final.q) if isinstance(scene, SpringPendulum) else motion.final.q)[1]


values = [scene.mass, scene.stiffness, scene.length, scene.wall, scene.e]
there = hs.State(scene.tip(start.q), [0.0, 0.0])
gradient = jax.value_and_grad(lambda values, kind, start: end(kind(*values), start))
polar, by_polar = gradient(values, SpringPendulum, start)
cartesian, by_cartesian = gradient(values, Cartesian, there)
print(f"height of the tip at 3 s: {polar:.10f} m and {cartesian:.10f} m")
for name, one, other in zip(numbers, by_polar, by_cartesian, strict=True):
    print(f"    by {name:<10} {one:+.9f} and {other:+.9f}")
np.testing.assert_allclose(by_polar, by_cartesian, rtol=1e-6, atol=1e-7)

# %% [markdown]
# ## The answer
#
# Write the energies, and the equations are right by construction; the energy balance shows it, and a second
# description agrees in value and gradient. `hs.check_gradient(scene, cost)` does the testing of gradients for you,
# event by event.
