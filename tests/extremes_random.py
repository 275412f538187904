"""Scenes at random: up to four flat contacts of a body with three coordinates, and what must hold of every motion."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import hybridsens as hs


class RandomScene(hs.AbstractScene):
    """M q'' = load - K q - c q', gaps normals q + offsets."""

    mass: Array
    load: Array
    stiffness: Array
    damping: Array
    normals: Array
    offsets: Array
    e: Array

    def mass_matrix(self, q):
        return self.mass

    def force(self, t, q, v):
        return self.load - self.stiffness @ q - self.damping * v

    def gap(self, t, q):
        return self.normals @ q + self.offsets

    def restitution(self):
        return self.e


def draw(seed: int) -> tuple[RandomScene, Array, Array]:
    """A scene, and a state that does not penetrate; half of the contacts start closed or nearly so."""
    rng = np.random.default_rng(seed)
    root = np.tril(rng.normal(size=(3, 3)), -1) + np.diag(10.0 ** rng.uniform(-1.5, 1.5, 3))
    spring = rng.normal(size=(3, 3)) * rng.choice([0.0, 1.0, 5.0])
    normals = rng.normal(size=(4, 3))
    q = rng.normal(size=3)
    gaps = rng.choice([0.0, 1e-9, 0.1, 1.0], size=4) * rng.uniform(0.5, 1.5, 4)
    e = np.full(4, rng.choice([0.0, 0.3, 0.7]))  # one for all: for mixed ones the law itself may add energy
    load, v = 5 * rng.normal(size=3), rng.normal(size=3) * rng.choice([0.0, 1.0])
    parts = root @ root.T, load, spring @ spring.T, rng.uniform(0, 0.5), normals, gaps - normals @ q, e
    return RandomScene(*(jnp.array(part, float) for part in parts)), jnp.array(q), jnp.array(v)


def energy(scene, q, v):
    """Kinetic and potential energy; neither contacts nor damping can raise it."""
    return v @ scene.mass @ v / 2 + q @ scene.stiffness @ q / 2 - scene.load @ q


@eqx.filter_jit
def run(scene, q, v, t1):
    """Trajectory with 101 samples from 0 to t1."""
    ts = jnp.linspace(0, t1, 101)
    return hs.simulate(scene, hs.State(q, v), t1=t1, ts=ts, rtol=1e-9, atol=1e-9, max_steps=16384, throw=False)


@eqx.filter_jit
def directional(scene, q, v, t1, direction):
    """Derivative of sum(final q) along a direction in (scene, q, v), forward and reverse."""

    def cost(inputs, adjoint):
        scene, q, v = inputs
        trajectory = hs.simulate(
            scene, hs.State(q, v), t1=t1, rtol=1e-9, atol=1e-9, max_steps=16384, throw=False, adjoint=adjoint
        )
        return jnp.sum(trajectory.final.q)

    inputs = scene, q, v
    gradient = jax.grad(cost)(inputs, hs.Replay())
    reverse = sum(jnp.vdot(g, d) for g, d in zip(jax.tree.leaves(gradient), jax.tree.leaves(direction), strict=True))
    forward = jax.jvp(lambda inputs: cost(inputs, hs.ForwardSensitivities()), (inputs,), (direction,))[1]
    return forward, reverse


def violations(scene, q, v, trajectory) -> dict[str, float]:
    """Largest violation of each law of a passive motion, relative to the motion's own sizes; all should be rounding."""
    n = int(trajectory.events.count)
    before, after = trajectory.events.before, trajectory.events.after
    length = 1 + float(jnp.max(jnp.abs(trajectory.q)))
    energies = [energy(scene, q, v), *(energy(scene, *state) for state in zip(before.q[:n], before.v[:n], strict=True))]
    energies_after = [energies[0], *(energy(scene, *state) for state in zip(after.q[:n], after.v[:n], strict=True))]
    size = 1 + max(abs(float(e)) for e in energies)
    gains = [later - earlier for earlier, later in zip(energies_after[:-1], energies[1:], strict=True)]
    jumps = [a - b for b, a in zip(energies[1:], energies_after[1:], strict=True)]
    jumped = scene.mass @ (after.v[:n] - before.v[:n]).T - scene.normals.T @ trajectory.events.impulse[:n].T
    return {
        "penetration": float(jnp.max(-(trajectory.q @ scene.normals.T + scene.offsets))) / length,
        "energy between events": max([0.0, *map(float, gains)]) / size,
        "energy at events": max([0.0, *map(float, jumps)]) / size,
        "impulse balance": float(jnp.max(jnp.abs(jumped), initial=0.0)) / size,
        "negative impulse": float(jnp.max(-trajectory.events.impulse[:n], initial=0.0)) / size,
        "order of events": float(np.max(-np.diff(np.asarray(trajectory.events.time[:n])), initial=0.0)),
    }
