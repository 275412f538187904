"""Is this gradient right? The adjoint against forward sensitivities, against differences, and event by event."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..adjoint.methods import AbstractGradientMethod, ForwardSensitivities, Replay
from ..export.html import preformatted
from ..mechanics.scene import AbstractScene
from ..parameters import FlatParameters, flatten_parameters
from ..waiting import waiting
from .check_causes import Cause, find_causes
from .check_events import EventCheck, check_events
from .check_motions import on_sequence, value_with_calls
from .check_reference import reference_gradient, resolved_gradient
from .check_report import format_check
from .differentiate import value_and_gradient
from .finite_differences import best_finite_differences
from .functional import Cost, choose_cost, functional, raise_unless_reached_end
from .gradient_methods import from_adjoint


class ParameterCheck(NamedTuple):
    """One entry of the gradient by three methods."""

    parameter: str
    adjoint: float
    forward: float
    differences: float
    """With the sequence of events kept; nan where it changes within the smallest difference tried."""
    uncertainty: float
    """How far the differences of two widths are apart."""
    reference: float
    """By another solver, with the derivative resolved much better; nan where that takes too many steps."""
    verdict: str
    """Empty where all agree."""


class GradientCheck(NamedTuple):
    """Outcome of a check; print it."""

    parameters: tuple[ParameterCheck, ...]
    events: tuple[EventCheck, ...]
    causes: tuple[Cause, ...] = ()
    """Likely causes of what is in doubt."""

    @property
    def ok(self) -> bool:
        """Whether every test that could be made was passed, and each parameter could be tested."""
        return not any(check.verdict for check in (*self.parameters, *self.events))

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        return preformatted(self)

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
    progress: bool = True,
) -> GradientCheck:
    """Check the gradient of a cost, and say which parameter and which event disagree.

    1. The adjoint against forward sensitivities, to 1e-4 `tolerance`: both are exact for the computed motion.
    2. Both against differences of fourth order, to `tolerance`; a difference counts only if the motions on all of its
       points have the same sequence of events.
    3. Both against a reference, to `tolerance`: another solver with tighter tolerances, and steps that resolve the
       derivative much better. Differences of long steps may share their defect.
    4. The same for every event by itself, on the piece of motion from half way after the last event to half way before
       the next; and there the determinant of the state's variation, which is known: e^2 at an impact (0 with a held
       contact) times exp(int tr f_x dt). For motions of a scene.

    Where something is in doubt, `causes` says what is likely behind it, and what to do.

    Arguments: as `compare`; `cost(scene, simulate)` must call `simulate` outside of `jax.jit` and `jax.vmap`. `adjoint`
    is the reverse method to check, one that is exact for the computed motion; by default `Replay()`. `rtol`, `atol`: of
    the motions; differences divide their noise by the width, so they are tight. `progress`: say on a terminal
    what is waited for; a check compiles some ten programs, which takes a minute or more.

    Raises: SimulationError if the motion does not reach its end.
    """
    cost = choose_cost(scene, cost)
    settings = dict(rtol=rtol, atol=atol, max_events=max_events, max_steps=max_steps)
    with waiting("compiling the adjoint", progress) as tell:
        return _check(flatten_parameters(scene), cost, adjoint or Replay(), tolerance, settings, tell)


def _check(
    parameters: FlatParameters, cost: Cost, method: AbstractGradientMethod, tolerance: float, settings: dict[str, Any],
    tell: Callable[[str], None],
) -> GradientCheck:  # fmt: skip
    """The check in the order of its tests; `tell` hears which one is being made."""
    reverse = _gradient(parameters, cost, method, settings)
    tell("compiling forward sensitivities")
    forward = _gradient(parameters, cost, ForwardSensitivities(), settings)
    tell("differences")
    value = value_with_calls(parameters, cost, settings)
    J, calls = value(parameters.vector)
    scale = _scale(parameters.vector, float(J), reverse)
    found = best_finite_differences(on_sequence(value, calls), parameters.vector, scale)
    size = _size(reverse, forward, scale)
    counts = [int(call.events.count) for call in calls]
    tell("compiling the reference")
    reference = reference_gradient(parameters, cost, settings, counts)
    slopes = np.stack([reverse, forward, found.slopes, found.uncertainty, reference], axis=1).tolist()
    limits = (tolerance * size).tolist()
    checks = []
    for name, (by_adjoint, by_forward, by_differences, uncertainty, known), limit in zip(
        parameters.names, slopes, limits, strict=True
    ):
        entry = ParameterCheck(name, by_adjoint, by_forward, by_differences, uncertainty, known, "")
        checks.append(entry._replace(verdict=_verdict(entry, limit)))
    tell("checking each event")
    mechanical = [(number, call) for number, call in enumerate(calls) if isinstance(call.scene, AbstractScene)]
    events = [check for number, call in mechanical for check in check_events(number, call, tolerance, settings)]
    tell("looking for causes")
    off = _resolved(checks, limits, lambda: resolved_gradient(parameters, cost, settings, counts))
    return GradientCheck(tuple(checks), tuple(events), find_causes(checks, events, calls, off, settings))


def _resolved(checks, limits: list[float], resolve: Callable) -> dict[str, bool]:
    """The parameters that are off the reference, and whether the gradient's steps resolve the derivative there.

    They do where shorter steps of the same motion leave the gradient as it is.
    """
    entries = list(zip(checks, limits, strict=True))
    off = [k for k, (entry, limit) in enumerate(entries) if entry.verdict and _off(entry, entry.reference, limit)]
    if not off:
        return {}
    right = resolve().tolist()  # nan where that took too many steps
    return {checks[k].parameter: not (np.isnan(right[k]) or _off(checks[k], right[k], limits[k])) for k in off}


def _off(entry: ParameterCheck, right: float, limit: float) -> bool:
    """Whether one of the two exact methods is off what should be right; nan, for want of steps, is."""
    return any(np.isnan(slope) or abs(slope - right) > limit for slope in (entry.adjoint, entry.forward))


def _gradient(parameters: FlatParameters, cost: Cost, adjoint: AbstractGradientMethod, settings):
    method = from_adjoint(adjoint, **settings)
    run = value_and_gradient(functional(parameters, cost, method.simulate), method.mode)
    _, gradient, reported = run(parameters.vector)
    raise_unless_reached_end(reported)
    return np.asarray(gradient)


def _scale(vector, J: float, gradient):
    """How far each parameter is moved: by a part of itself, or of what changes J by as much as J itself."""
    slope = np.abs(gradient)
    natural = np.where(slope > 0, abs(J) / np.where(slope > 0, slope, 1), 1.0)
    # A J that is 0 by symmetry is so but for rounding.
    return np.where(np.asarray(vector) != 0, np.abs(vector), np.where(natural > 1e-8, natural, 1.0))


def _size(adjoint, forward, scale):
    """What a deviation of an entry is measured by: the entry itself, or a thousandth of the whole gradient's effect."""
    largest = np.max(np.abs(adjoint) * scale)
    return np.fmax(np.fmax(np.abs(adjoint), np.abs(forward)), 1e-3 * largest / scale)


def _verdict(entry: ParameterCheck, limit: float) -> str:
    if not abs(entry.adjoint - entry.forward) <= 1e-4 * limit:
        return "adjoint and forward sensitivities disagree"
    if abs(entry.adjoint - entry.reference) > limit:  # False where there is none
        return "the reference disagrees"
    if np.isnan(entry.differences):
        return "not decided: the sequence of events changes within the smallest difference"
    distance = abs(entry.adjoint - entry.differences)
    if distance <= limit:
        return ""
    if distance <= 3 * entry.uncertainty:
        return f"not decided: differences are uncertain by {entry.uncertainty:.1e}"
    return "differences disagree"
