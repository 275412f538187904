"""The gradient of a ready-made scene's functional by three methods, timed: what `hybridsens demo` shows."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..mechanics.switches import has_switches
from ..mechanics.trajectory import Trajectory
from ..parameters import flatten_parameters
from ..solution import Solution
from ..status import Status
from ..system import AbstractHybridSystem
from .baselines import where_reset, where_transition
from .differentiate import best_finite_differences
from .functional import move, ready_made_motion
from .timing import first_call, seconds_per_call

REFERENCE_TOLERANCE = 1e-12
"""Of the motions that differences are taken of: they divide the noise of step selection by their width."""
SAMPLES = 2001
NAIVE_STEPS = 20_000


class Timing(NamedTuple):
    """How long a program took."""

    first: float
    """The first call: tracing, compiling and running once [s]."""
    run: float
    """One call after that [s]."""


class Demonstration(NamedTuple):
    """A functional J of one motion and its gradient by three methods. The parameters are in the order of `names`."""

    trajectory: Trajectory | Solution
    names: list[str]
    parameters: Float[np.ndarray, "parameter"]
    cost: float
    """J = int running_cost dt."""
    naive_cost: float
    """J of the naive loop."""
    adjoint: Float[np.ndarray, "parameter"]
    """dJ/dtheta by the adjoint with its jump conditions."""
    differences: Float[np.ndarray, "parameter"]
    """dJ/dtheta by differences of J at tolerance `REFERENCE_TOLERANCE`."""
    one_sided: Bool[np.ndarray, "parameter"]
    """Whether the differences could be taken to one side only (a coefficient of restitution of 1, say)."""
    naive: Float[np.ndarray, "parameter"]
    """dJ/dtheta by automatic differentiation of the naive loop."""
    timings: dict[str, Timing]
    """By what was run."""


def demonstrate(scene: Any, *, tolerance: float = 1e-8) -> Demonstration:
    """Run a scene or a system, ready-made or one's own, and differentiate its functional by the jump adjoint, by
    differences and naively.

    Raises: SimulationError if the motion does not reach its end; ValueError for a setting that `simulate` refuses, and
    for a scene with switches of its own.
    """
    if has_switches(scene):
        raise ValueError(
            "demo compares with a loop that knows impacts alone, but the scene has switches of its own: use "
            "`hybridsens check`, or `simulate`."
        )
    ts = jnp.linspace(0.0, scene.t1, SAMPLES)
    trajectory = ready_made_motion(scene, move, ts=ts, rtol=tolerance, atol=tolerance)
    names, theta, unravel = flatten_parameters(scene)
    cost = lambda theta: _cost(unravel(theta), rtol=tolerance, atol=tolerance)
    tight = lambda theta: _cost(unravel(theta), rtol=REFERENCE_TOLERANCE, atol=REFERENCE_TOLERANCE, max_steps=2**16)
    naive = lambda theta: _naive_cost(unravel(theta), NAIVE_STEPS)
    _, motion_time = timed(cost, theta)
    (value, adjoint), adjoint_time = timed(jax.value_and_grad(cost), theta)
    (naive_value, naive_gradient), naive_time = timed(jax.value_and_grad(naive), theta)
    scale = np.where(theta == 0, 1.0, np.abs(theta))
    slopes, _, one_sided = best_finite_differences(jax.jit(tight), np.asarray(theta), scale)
    return Demonstration(
        trajectory, list(names), np.asarray(theta), float(value), float(naive_value),
        np.asarray(adjoint), slopes, one_sided, np.asarray(naive_gradient),
        {"motion": motion_time, "motion and gradient": adjoint_time, f"naive gradient, {NAIVE_STEPS} steps": naive_time}
    )  # fmt: skip


def timed(function: Callable[[Any], Any], argument: Any) -> tuple[Any, Timing]:
    """Value of a function of one argument, with the times that its first call and a later one take."""
    compiled = jax.jit(function)
    call = lambda: compiled(argument)
    value, first = first_call(call)
    return value, Timing(first, seconds_per_call(call))


def _cost(scene, **settings):
    """J, or nan where the motion does not reach its end."""
    trajectory = ready_made_motion(scene, move, throw=False, **settings)
    return jnp.where(trajectory.status == Status.successful, trajectory.cost, jnp.nan)


def _naive_cost(scene, steps: int):
    loop = where_transition if isinstance(scene, AbstractHybridSystem) else where_reset
    return ready_made_motion(scene, loop, steps=steps).cost
