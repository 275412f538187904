"""Penalty contact: springs and dampers instead of constraints, in fixed steps, differentiated as it stands."""

import diffrax
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ...mechanics.contact import contact_geometry, gap_and_rate
from ...mechanics.flow import free_acceleration
from ...mechanics.scene import AbstractScene, State
from .motion import BaselineMotion, flat_problem

LEAST_RESTITUTION = 0.01
"""The damper for e = 0 would be infinite."""


class PenaltyScene(AbstractScene):
    """A scene whose contacts push with f = -k Phi - c Phi' where Phi < 0, and are no constraints any more.

    At the end of a rebound they pull: cut at f = 0, a rebound would be faster than e, 0.25 where e is 0.1."""

    scene: AbstractScene
    stiffness: Float[Array, "contact"]
    """k [N/m]"""

    def mass_matrix(self, q):
        return self.scene.mass_matrix(q)

    def force(self, t, q, v):
        gap, rate = gap_and_rate(self.scene, t, q, v)
        geometry = contact_geometry(self.scene, t, q)
        mobility = jnp.where(gap < 0, geometry.delassus.diagonal(), 1)
        push = -self.stiffness * gap - self.damping(mobility) * rate
        return self.scene.force(t, q, v) + geometry.jacobian.T @ jnp.where(gap < 0, push, 0)

    def gap(self, t, q):
        return jnp.zeros(0, q.dtype)

    def restitution(self):
        return jnp.zeros(0, self.stiffness.dtype)

    def damping(self, mobility: Float[Array, "contact"]) -> Float[Array, "contact"]:
        """c = 2 D sqrt(k / W) with D = -ln e / sqrt(pi^2 + ln^2 e): a free impact then rebounds with e.

        `mobility` is W_ii of each contact by itself, where it is struck [1/kg]."""
        log_e = jnp.log(jnp.maximum(self.scene.restitution(), LEAST_RESTITUTION))
        ratio = -log_e / jnp.sqrt(jnp.pi**2 + log_e**2)
        return 2 * ratio * jnp.sqrt(self.stiffness / mobility)


def soften(scene: AbstractScene, state: State, t0, contact_time) -> PenaltyScene:
    """The scene with springs such that a free impact lasts `contact_time`: k = (pi / contact_time)^2 / W_ii, with the
    W_ii of the start."""
    W = contact_geometry(scene, jnp.asarray(t0, state.q.dtype), state.q).delassus
    return PenaltyScene(scene, (jnp.pi / contact_time) ** 2 / lax.stop_gradient(W.diagonal()))


def penalty_contact(
    scene: AbstractScene, state: State, *, t0=0.0, t1, ts=None, running_cost=None, steps: int = 10_000,
    contact_time: float | None = None,
) -> BaselineMotion:  # fmt: skip
    """Motion with penalty contacts, in `steps` equal steps of Tsit5.

    `contact_time` [s] sets the stiffness once for all parameters; by default 1/500 of the horizon, whatever the
    step. With a shorter step the motion converges to that of the springs, not of the scene.
    """
    contact_time = (t1 - t0) / 500 if contact_time is None else contact_time
    soft = soften(scene, state, t0, contact_time)
    cost = None if running_cost is None else lambda _, t, q, v: running_cost(scene, t, q, v)
    system, x0, structured = flat_problem(soft, state, t0, cost)

    def field(t, x, system):
        q, v, _ = system.split(x)
        integrands = [jnp.ravel(leaf) for leaf in jax.tree.leaves(system.cost_rate(t, q, v))]
        return jnp.concatenate([v, free_acceleration(system.scene, t, q, v), *integrands])

    saveat = diffrax.SaveAt(t1=True) if ts is None else diffrax.SaveAt(t1=True, ts=ts)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field), diffrax.Tsit5(), t0, t1, (t1 - t0) / steps, x0, args=system, saveat=saveat,
        max_steps=steps + 8,
    )  # fmt: skip
    assert solution.ys is not None
    q, v, z = system.split(solution.ys[-1])
    samples = (None, None) if ts is None else system.split(solution.ys[:-1])[:2]
    return BaselineMotion(State(q, v), structured(z), ts, *samples)
