"""How fast neighbouring motions part: the finite-time Lyapunov exponent, from the product of saltation matrices."""

from typing import Any, NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..adjoint.control import is_noise
from ..adjoint.methods import ForwardSensitivities
from ..export.text import array_text, preformatted
from ..mechanics.scene import AbstractScene
from ..mechanics.trajectory import Trajectory
from ..solution import Solution
from ..system import AbstractHybridSystem
from ..system_checks import state_as_arrays
from .functional import move


class Growth(NamedTuple):
    """How variations of the initial state grow along a motion."""

    exponent: Float[Array, ""]
    """log(growth) / (end - t0), the largest finite-time Lyapunov exponent [1/s]; nan for a motion that broke off
    before t1 (with `throw=False`), whose growth and matrix are those of its last state, and where `growth` is below
    2e-13 (in single precision 1e-4): variations that have shrunk so far are rounding. Begin again where they are
    larger: of motions that follow one another the matrices are to be multiplied."""
    growth: Float[Array, ""]
    """Largest singular value of `matrix`: by how much the worst variation of the initial state is multiplied."""
    matrix: Float[Array, "state state"]
    """d x(t1) / d x(t0), x = (q, v) of a scene: flows between events and saltation matrices at events,
    S_N ... S_2 S_1."""
    trajectory: Trajectory | Solution

    _repr_html_ = preformatted  # what a notebook shows

    def __str__(self) -> str:
        if np.ndim(self.growth) > 0 or isinstance(self.growth, jax.core.Tracer):
            return repr(self)
        status, events = self.trajectory.status, self.trajectory.events.count
        return (
            f"exponent {float(self.exponent):.6g}: a variation of the initial state grows {float(self.growth):.6g} "
            f"times, at most\nmatrix:\n{array_text(self.matrix)}\nmotion: {status}, {int(events)} events"
        )


def lyapunov(
    scene: AbstractScene | AbstractHybridSystem,
    state: Any,
    mode: Any = None,
    *,
    t0: float | Array = 0.0,
    t1: float | Array,
    **settings: Any,
) -> Growth:
    """Growth of small variations of the initial state over [t0, t1].

    A gradient is right as long as its motion is; but where `growth` times the tolerance reaches the size of the motion
    itself, motion and gradient are those of another initial state. Divide `rtol` and `atol` by `growth`, or shorten the
    horizon. The units of the entries are mixed in the singular value, so compare growths of one scene. Over a short
    horizon the exponent of a stable motion may be positive: the growth by a constant factor fades as 1 / (t1 - t0).
    Of two horizons T1 < T2 take log(growth2 / growth1) / (T2 - T1).

    Arguments: a scene and its `State`, or a hybrid system and its x0; the mode of a system or of a scene with
    switches; the `settings` of `simulate` or `solve` but `adjoint` and `running_cost`. Raises what these raise.
    """
    refused = {"adjoint", "running_cost"} & settings.keys()
    if refused:
        raise TypeError(f"`lyapunov` must be called without {sorted(refused)}.")
    if isinstance(scene, AbstractHybridSystem):
        state, _ = state_as_arrays(state)  # numbers may be integers, which have no derivative
    start, unravel = ravel_pytree(state)

    def final(x):
        method = ForwardSensitivities()
        trajectory = move(scene, unravel(x), mode, t0=t0, t1=t1, adjoint=method, **settings)
        return ravel_pytree(trajectory.final)[0], trajectory

    matrix, trajectory = jax.jacfwd(final, has_aux=True)(start)
    growth = jnp.linalg.norm(matrix, 2)
    known = trajectory.status.reached_end & ((growth == 0) | ~is_noise(growth, jnp.ones_like(growth)))
    exponent = jnp.where(known, jnp.log(growth) / (trajectory.end_time - t0), jnp.nan)
    return Growth(exponent, growth, matrix, trajectory)
