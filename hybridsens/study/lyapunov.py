"""How fast neighbouring motions part: the finite-time Lyapunov exponent, from the product of saltation matrices."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..adjoint.methods import ForwardSensitivities
from ..mechanics.scene import AbstractScene, State
from ..simulate import simulate
from ..trajectory import Trajectory


class Growth(NamedTuple):
    """How variations of the initial state grow along a motion."""

    exponent: Float[Array, ""]
    """log(growth) / (t1 - t0), the largest finite-time Lyapunov exponent [1/s]."""
    growth: Float[Array, ""]
    """Largest singular value of `matrix`: by how much the worst variation of the initial state is multiplied."""
    matrix: Float[Array, "state state"]
    """d (q, v)(t1) / d (q, v)(t0): flows between events and saltation matrices at events, S_N ... S_2 S_1."""
    trajectory: Trajectory


def lyapunov(
    scene: AbstractScene, state: State, *, t0: float | Array = 0.0, t1: float | Array, **settings: Any
) -> Growth:
    """Growth of small variations of the initial state over [t0, t1].

    A gradient is right as long as its motion is; but where `growth` times the tolerance reaches the size of the motion
    itself, motion and gradient are those of another initial state. Divide `rtol` and `atol` by `growth`, or shorten the
    horizon. The units of q and v are mixed in the singular value, so compare growths of one scene.

    Takes the `settings` of `simulate` but `adjoint` and `running_cost`. Raises what `simulate` raises.
    """
    refused = {"adjoint", "running_cost"} & settings.keys()
    if refused:
        raise TypeError(f"`lyapunov` must be called without {sorted(refused)}.")
    dof = state.q.shape[0]

    def final(x):
        start = State(x[:dof], x[dof:])
        trajectory = simulate(scene, start, t0=t0, t1=t1, adjoint=ForwardSensitivities(), **settings)
        return jnp.concatenate([trajectory.final.q, trajectory.final.v]), trajectory

    matrix, trajectory = jax.jacfwd(final, has_aux=True)(jnp.concatenate([state.q, state.v]))
    growth = jnp.linalg.norm(matrix, 2)
    return Growth(jnp.log(growth) / (t1 - t0), growth, matrix, trajectory)
