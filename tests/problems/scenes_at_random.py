"""Scenes at random: one to four coordinates, one to four contacts, in one shape so that one compiled function serves.

Coordinates that a scene does not have are free particles at rest; contacts that it does not have are far away.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import hybridsens as hs

SIZE = 4
"""Coordinates and contacts that every scene has room for."""
HORIZON = 3.0
TOLERANCE = 1e-10
SETTINGS = dict(rtol=TOLERANCE, atol=TOLERANCE, max_events=1024, max_steps=16384, throw=False)


class RandomScene(hs.AbstractScene):
    """M q'' = load - K q - c q', gaps offset + normal y + y curvature y / 2 with y = q - shake sin(pace t).

    All contacts belong to one frame, which may shake: so there is always room between them."""

    mass: Array
    load: Array
    stiffness: Array
    damping: Array
    normals: Array
    offsets: Array
    curvature: Array
    shake: Array
    pace: Array
    e: Array

    def mass_matrix(self, q):
        return self.mass

    def force(self, t, q, v):
        return self.load - self.stiffness @ q - self.damping * v

    def gap(self, t, q):
        y = q - self.shake * jnp.sin(self.pace * t)
        return self.offsets + self.normals @ y + jnp.einsum("kij,i,j->k", self.curvature, y, y) / 2

    def restitution(self):
        return self.e


class Draw(NamedTuple):
    """A scene at random, and where it starts."""

    scene: RandomScene
    state: hs.State

    @property
    def passive(self) -> bool:
        """Whether energy must never grow: no contact moves, and all that touch share one restitution.

        For unequal ones Newton's law itself may add energy when several contacts strike at once."""
        e = np.asarray(self.scene.e)
        return bool(np.all(np.asarray(self.scene.shake) == 0) and np.all(e == e[0]))

    @property
    def elastic(self) -> bool:
        """Whether some contact gives all energy back, so that a pressed cascade of impacts need not end."""
        return bool(np.any(np.asarray(self.scene.e) == 1))


def draw(seed: int) -> Draw:
    """A scene and a state that does not penetrate; half of the contacts start closed or nearly so."""
    rng = np.random.default_rng(seed)
    dof, contacts = rng.integers(1, SIZE + 1, 2)
    here = np.arange(SIZE) < dof
    there = np.arange(SIZE) < contacts
    q, v = rng.normal(size=(2, SIZE)) * here
    v = v * rng.choice([0.0, 1.0])
    normals = rng.normal(size=(SIZE, SIZE)) * there[:, None] * here
    curvature = _bowls(rng) * there[:, None, None] * here[:, None] * here
    gap = rng.choice([0.0, 1e-9, 0.1, 1.0], SIZE) * rng.uniform(0.5, 1.5, SIZE)
    offsets = np.where(there, gap - normals @ q - np.einsum("kij,i,j->k", curvature, q, q) / 2, 1.0)
    shake = rng.normal(size=SIZE) * here * rng.choice([0.0, 0.0, 0.05])
    load = 5 * rng.normal(size=SIZE) * here
    parts = [
        _mass(rng, here), load, _spring(rng, here), rng.uniform(0, 0.5), normals, offsets, curvature, shake,
        rng.uniform(2, 20), _restitution(rng),
    ]  # fmt: skip
    scene = RandomScene(*(jnp.array(part, float) for part in parts))
    return Draw(scene, hs.State(jnp.array(q), jnp.array(v)))


def _mass(rng, here):
    """Symmetric positive definite with eigenvalues 0.1 to 10; 1 for a coordinate that is not there."""
    axes, _ = np.linalg.qr(rng.normal(size=(SIZE, SIZE)))
    full = axes * 10.0 ** rng.uniform(-1, 1, SIZE) @ axes.T
    return np.where(np.outer(here, here), (full + full.T) / 2, np.eye(SIZE))


def _spring(rng, here):
    root = rng.normal(size=(SIZE, SIZE)) * rng.choice([0.0, 1.0, 3.0])
    return np.where(np.outer(here, here), root @ root.T, 0.0)


def _bowls(rng):
    """Curvature of each gap: none in half of the scenes."""
    half = rng.normal(size=(SIZE, SIZE, SIZE)) * rng.choice([0.0, 0.3])
    return (half + half.transpose(0, 2, 1)) / 2


def _restitution(rng):
    """One for all contacts in three scenes of four."""
    common = np.full(SIZE, rng.choice([0.0, 0.2, 0.5, 0.7, 1.0]))
    return common if rng.uniform() < 0.75 else rng.choice([0.0, 0.2, 0.5, 0.7], SIZE)


def at_rest(given: Draw) -> Draw:
    """The same scene in equilibrium, its contacts open: a motion that is trivial, with derivatives that are not."""
    scene, q = given.scene, given.state.q
    load, offsets = scene.stiffness @ q, scene.offsets + 2
    scene = eqx.tree_at(lambda s: (s.load, s.offsets, s.shake), scene, (load, offsets, jnp.zeros_like(scene.shake)))
    return Draw(scene, hs.State(q, jnp.zeros_like(q)))


def in_flight(given: Draw) -> Draw:
    """The same scene without springs, damping and shaking: flights between its impacts."""
    scene = given.scene
    still = (jnp.zeros_like(scene.stiffness), jnp.zeros_like(scene.damping), jnp.zeros_like(scene.shake))
    flat = jnp.zeros_like(scene.curvature)
    scene = eqx.tree_at(lambda s: (s.stiffness, s.damping, s.shake, s.curvature), scene, (*still, flat))
    return Draw(eqx.tree_at(lambda s: s.offsets, scene, scene.offsets + 0.1), given.state)


@eqx.filter_jit
def move(scene: RandomScene, state: hs.State) -> hs.Trajectory:
    """The motion, with 201 samples."""
    return hs.simulate(scene, state, t1=HORIZON, ts=jnp.linspace(0, HORIZON, 201), **SETTINGS)


def final_sum(trajectory: hs.Trajectory):
    """What is differentiated: a sum over the final state."""
    return jnp.sum(trajectory.final.q) + 0.3 * jnp.sum(trajectory.final.v)


@eqx.filter_jit
def slopes(given: Draw, direction: Draw):
    """Derivative of `final_sum` along a direction, by forward and by reverse mode."""

    def cost(given, adjoint):
        return final_sum(hs.simulate(*given, t1=HORIZON, adjoint=adjoint, **SETTINGS))

    gradient = jax.grad(cost)(given, hs.Replay())
    parts = zip(jax.tree.leaves(gradient), jax.tree.leaves(direction), strict=True)
    reverse = sum(jnp.vdot(g, d) for g, d in parts)
    forward = jax.jvp(lambda given: cost(given, hs.ForwardSensitivities()), (given,), (direction,))[1]
    return forward, reverse


def random_direction(given: Draw, rng: np.random.Generator) -> Draw:
    """A direction in everything that is not zero: scene and initial state."""
    return jax.tree.map(lambda leaf: jnp.asarray(rng.normal(size=leaf.shape)) * (leaf != 0), given)


def load_alone(given: Draw, direction: Draw) -> Draw:
    """Only its part in the load, which takes no closed contact apart."""
    nothing = jax.tree.map(jnp.zeros_like, direction)
    return eqx.tree_at(lambda draw: draw.scene.load, nothing, direction.scene.load)


def load_and_state(given: Draw, rng: np.random.Generator) -> Draw:
    """A direction in the load and in the initial state, also where these are zero."""
    nothing = jax.tree.map(jnp.zeros_like, given)
    where = lambda draw: (draw.scene.load, draw.state.q, draw.state.v)
    return eqx.tree_at(where, nothing, tuple(jnp.asarray(rng.normal(size=SIZE)) for _ in range(3)))


def difference_slope(given: Draw, direction: Draw, step: float) -> float | None:
    """Fourth-order difference of `final_sum`; None where the sequence of events is not the same at its four points."""
    motions = [move(*jax.tree.map(lambda x, d, h=h: x + h * step * d, given, direction)) for h in (1, -1, 2, -2)]
    reference = move(*given).events
    for motion in motions:
        same = jnp.all(motion.events.contact == reference.contact) & jnp.all(motion.events.kind == reference.kind)
        if motion.status != hs.Status.successful or not same:
            return None
    up, down, far_up, far_down = (float(final_sum(motion)) for motion in motions)
    return (8 * (up - down) - (far_up - far_down)) / (12 * step)
