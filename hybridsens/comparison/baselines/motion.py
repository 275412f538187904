"""What a baseline returns: as much of a `Trajectory`, or of a `Solution`, as it knows."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...mechanics.events import Events
from ...mechanics.mode import default_capture_speed
from ...mechanics.scene import AbstractScene, State
from ...mechanics.system import MechanicalSystem
from ...numerics.shapes import Shapes


class BaselineMotion(eqx.Module):
    """A motion from t0 to t1, with the names of a `Trajectory`, or of a `Solution`."""

    final: Any
    """State at t1."""
    cost: Any
    """Integral of the running cost, with its structure; None without one."""
    ts: Float[Array, "sample"] | None = None
    """Times asked for."""
    q: Float[Array, "sample dof"] | None = None
    """Configurations there."""
    v: Float[Array, "sample dof"] | None = None
    """Velocities there."""
    recorded: Events | None = None
    """Events, by a method that finds them."""
    mode: Any = None
    """Mode of a hybrid system at t1."""

    @property
    def events(self) -> Events:
        """Events of the motion. Raises: NotImplementedError where the method does not find them one by one."""
        if self.recorded is None:
            raise NotImplementedError("this method does not know its events one by one")
        return self.recorded


def flat_problem(scene: AbstractScene, state: State, t0, running_cost):
    """The scene as a hybrid system, its flat initial state (q, v, 0), and the function that gives z its structure."""
    system = MechanicalSystem(scene, running_cost, default_capture_speed(state.q.dtype), state.q.shape[0])
    cost = Shapes.of(jax.eval_shape(lambda: system.cost_rate(jnp.asarray(t0, state.q.dtype), state.q, state.v)))
    return system, jnp.concatenate([state.q, state.v, jnp.zeros(cost.size, state.q.dtype)]), cost.restore
