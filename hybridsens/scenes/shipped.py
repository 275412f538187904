"""What every ready-made scene has beside its physics: where it starts, how long it runs, what it costs."""

import abc
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..mechanics.scene import AbstractScene, State
from ..model import parameter as parameter


def scalars(*values) -> tuple[Array, ...]:
    """Numbers as scalar parameters."""
    return tuple(jnp.asarray(value, jnp.result_type(float)) for value in values)


class ShippedScene(AbstractScene):
    """A scene that can be run as it is: `simulate(scene, scene.initial_state(), t1=scene.t1)`."""

    t1: ClassVar[float]
    """End of the horizon that shows the scene well [s]; it starts at 0."""

    @abc.abstractmethod
    def initial_state(self) -> State:
        """Where the motion starts, computed from the scene's parameters."""

    def running_cost(self, t, q, v) -> Float[Array, ""]:
        """Integrand of the scene's functional J; |q|^2 unless a scene says otherwise."""
        del t, v
        return q @ q
