"""Is this gradient right? The adjoint against forward sensitivities, against differences, and event by event."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..adjoint.methods import AbstractGradientMethod, ForwardSensitivities, Replay
from ..mechanics.scene import AbstractScene, State
from ..simulate import simulate
from ..status import Status
from ..trajectory import Events
from .check_events import EventCheck, check_events
from .check_report import format_check
from .differentiate import value_and_gradient
from .flat_parameters import FlatParameters, flatten_parameters
from .functional import Cost, choose_cost, functional, raise_unless_reached_end
from .gradient_methods import from_adjoint
from .scaled_differences import scaled_differences


class Call(NamedTuple):
    """One motion that a cost asked for."""

    scene: AbstractScene
    state: State
    t0: Float[Array, ""]
    t1: Float[Array, ""]
    events: Events
    status: Status


class ParameterCheck(NamedTuple):
    """One entry of the gradient by three methods."""

    parameter: str
    adjoint: float
    forward: float
    differences: float
    """With the sequence of events kept; nan where it changes within the smallest difference tried."""
    uncertainty: float
    """How far the differences of two widths are apart."""
    verdict: str
    """Empty where all agree."""


class GradientCheck(NamedTuple):
    """Outcome of a check; print it."""

    parameters: tuple[ParameterCheck, ...]
    events: tuple[EventCheck, ...]

    @property
    def ok(self) -> bool:
        """Whether every test that could be made was passed, and each parameter could be tested."""
        return not any(check.verdict for check in (*self.parameters, *self.events))

    def __str__(self) -> str:
        return format_check(self)


def check_gradient(
    scene: Any,
    cost: Cost | None = None,
    *,
    adjoint: AbstractGradientMethod | None = None,
    tolerance: float = 1e-5,
    rtol: float = 1e-12,
    atol: float = 1e-12,
    max_events: int = 256,
    max_steps: int = 16384,
) -> GradientCheck:
    """Check the gradient of a cost, and say which parameter and which event disagree.

    1. The adjoint against forward sensitivities, to 1e-4 `tolerance`: both are exact for the computed motion.
    2. Both against differences of fourth order, to `tolerance`; a difference counts only if the motions on all of its
       points have the same sequence of events.
    3. The same for every event by itself, on the piece of motion from half way after the last event to half way before
       the next; and there the determinant of the state's variation, which is known: e^2 at an impact (0 with a held
       contact) times exp(int tr f_x dt).

    Arguments: as `compare`; `cost(scene, simulate)` must call `simulate` outside of `jax.jit` and `jax.vmap`. `adjoint`
    is the reverse method to check, one that is exact for the computed motion; by default `Replay()`. `rtol`, `atol`: of
    the motions; differences divide their noise by the width, so they are tight.

    Raises: SimulationError if the motion does not reach its end.
    """
    cost = choose_cost(scene, cost)
    parameters = flatten_parameters(scene)
    settings = dict(rtol=rtol, atol=atol, max_events=max_events, max_steps=max_steps)
    reverse, forward = (
        _gradient(parameters, cost, method, settings) for method in (adjoint or Replay(), ForwardSensitivities())
    )
    value = eqx.filter_jit(_with_calls(parameters, cost, settings))
    J, calls = value(parameters.vector)
    scale = _scale(parameters.vector, float(J), reverse)
    found = scaled_differences(_on_sequence(value, calls), parameters.vector, scale)
    size = _size(reverse, forward, scale)
    slopes = zip(reverse, forward, found.slopes, found.uncertainty, strict=True)
    checks = []
    for name, (by_adjoint, by_forward, by_differences, uncertainty), limit in zip(
        parameters.names, np.asarray(list(slopes)).tolist(), (tolerance * size).tolist(), strict=True
    ):
        verdict = _verdict(by_adjoint, by_forward, by_differences, uncertainty, limit)
        checks.append(ParameterCheck(name, by_adjoint, by_forward, by_differences, uncertainty, verdict))
    events = [check for number, call in enumerate(calls) for check in check_events(number, call, tolerance, settings)]
    return GradientCheck(tuple(checks), tuple(events))


def _gradient(parameters: FlatParameters, cost: Cost, adjoint: AbstractGradientMethod, settings):
    method = from_adjoint(adjoint, **settings)
    run = value_and_gradient(functional(parameters, cost, method.simulate), method.mode)
    _, gradient, reported = run(parameters.vector)
    raise_unless_reached_end(reported)
    return np.asarray(gradient)


def _with_calls(parameters: FlatParameters, cost: Cost, settings) -> Callable:
    """vector -> (J, the motions that it came from)."""

    def value(vector):
        calls = []

        def recording(scene, state, *, t0=0.0, t1, **asked):
            motion = simulate(scene, state, t0=t0, t1=t1, throw=False, **(settings | asked))
            calls.append(Call(scene, state, jnp.asarray(t0), jnp.asarray(t1), motion.events, motion.status))
            return motion

        return cost(parameters.rebuild(vector), recording), tuple(calls)

    return value


def _on_sequence(value: Callable, nominal: tuple[Call, ...]) -> Callable:
    """J where the motions have the nominal sequence of events, nan where they do not."""

    def same(call: Call, known: Call) -> bool:
        return bool(call.status == Status.successful) and all(
            np.array_equal(getattr(call.events, name), getattr(known.events, name)) for name in ("kind", "contact")
        )

    def restricted(vector):
        J, calls = value(jnp.asarray(vector))
        return float(J) if all(map(same, calls, nominal)) else np.nan

    return restricted


def _scale(vector, J: float, gradient):
    """How far each parameter is moved: by a part of itself, or of what changes J by as much as J itself."""
    slope = np.abs(gradient)
    natural = np.where(slope > 0, abs(J) / np.where(slope > 0, slope, 1), 1.0)
    return np.where(np.asarray(vector) != 0, np.abs(vector), np.where(natural > 0, natural, 1.0))


def _size(adjoint, forward, scale):
    """What a deviation of an entry is measured by: the entry itself, or a thousandth of the whole gradient's effect."""
    largest = np.max(np.abs(adjoint) * scale)
    return np.maximum(np.maximum(np.abs(adjoint), np.abs(forward)), 1e-3 * largest / scale)


def _verdict(adjoint: float, forward: float, differences: float, uncertainty: float, limit: float) -> str:
    if not abs(adjoint - forward) <= 1e-4 * limit:
        return "adjoint and forward sensitivities disagree"
    if np.isnan(differences):
        return "not decided: the sequence of events changes within the smallest difference"
    if abs(adjoint - differences) <= limit:
        return ""
    if abs(adjoint - differences) <= 3 * uncertainty:
        return f"not decided: differences are uncertain by {uncertainty:.1e}"
    return "differences disagree"


