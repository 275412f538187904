"""Is this gradient right? The adjoint against forward sensitivities, against differences, and event by event."""

from collections.abc import Callable, Sequence
from typing import Any, Unpack

import diffrax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..adjoint.methods import AbstractGradientMethod, ForwardSensitivities, Replay
from ..mechanics.scene import AbstractScene
from ..mechanics.switches import has_switches
from ..parameters import FlatParameters, flatten_parameters
from ..settings import Settings, chosen_settings
from ..validation.arguments import real_tolerance
from ..waiting import waiting
from .check_causes import find_causes
from .check_default import at_default
from .check_events import check_events
from .check_motions import largest_state, on_sequence, value_with_calls
from .check_report import KINK, UNDECIDED, GradientCheck, ParameterCheck
from .check_sides import kink_at, kinked, one_sided, other_side
from .differentiate import QUICKLY, best_finite_differences, rounding_of_slopes, slopes_nearby
from .functional import Cost, all_reached_end, choose_cost, raise_unless_reached_end
from .gradient_methods import gradient_by


def check_gradient(
    scene: Any,
    cost: Cost | None = None,
    *,
    parameters: str | Sequence[str] | None = None,
    adjoint: AbstractGradientMethod | None = None,
    tolerance: float = 1e-5,
    progress: bool = True,
    **settings: Unpack[Settings],
) -> GradientCheck:
    """Check the gradient of a cost, and say which parameter and which event disagree.

    1. The adjoint against forward sensitivities, to 1e-2 `tolerance`: both are exact for the computed motion, each on
       the steps that it needs.
    2. Both against differences of fourth order, to `tolerance`; a difference counts only if the motions on all of its
       points have the same sequence of events.
    3. Both against a reference, to `tolerance`: another solver with tighter tolerances, and steps that resolve the
       derivative much better: steps that are too long for it spoil differences in the same way as gradients.
    4. Both sides of the point: where other events happen on one of them from the very point on, as where an event comes
       at `t1`, J must not jump, nor have another derivative on that side; and where the same happen, no kink.
    5. The same as in 1 and 2 for every event by itself, on the piece of motion from half way after the last event to
       half way before the next; and there the determinant of the state's variation, which is known: e^2 at an impact
       (0 with a held contact) times exp(int tr f_x dt). For motions of a scene.

    A deviation is measured by the largest of three: the entry; 1e-3 of the largest entry, each times its parameter; the
    slope that J has nearby. So a wrong entry passes if it is below `tolerance` times the other two.

    Where something is in doubt, `causes` says what is likely behind it, and what to do. `at_default` says what is left
    of the gradient at the tolerance that a motion has by default.

    Arguments: as `compare`; `cost(scene, simulate)` must call `simulate` outside of `jax.jit` and `jax.vmap`, without
    settings of its own. `parameters`: names of those to check, arrays or entries (["mass", "weight[3]"]); default all,
    each of which takes some thirty motions. `adjoint` is the reverse method to check, one that is exact for the
    computed motion; by default `Replay()`. `progress`: show what is waited for; a check compiles some ten programs,
    which takes a minute or more. `settings`: see `Settings`; by default rtol = atol = 1e-12, since differences divide
    the noise of motions by the width, 256 events and 16384 steps.

    Raises: SimulationError if the motion does not reach its end; TypeError for a cost that moves its scene otherwise;
    ValueError for a name that is none, a parameter or a cost that is not finite, or a `tolerance` that is not positive.
    """
    real_tolerance("tolerance", tolerance)
    cost = choose_cost(scene, cost)
    own = dict(rtol=1e-12, atol=1e-12, max_events=256, max_steps=16384)
    chosen = chosen_settings("check_gradient", settings, own)
    checked = flatten_parameters(scene)
    if parameters is not None:
        checked = checked.only([parameters] if isinstance(parameters, str) else parameters)
    with waiting("compiling the adjoint", progress) as tell:
        return _check(checked, cost, adjoint or Replay(), tolerance, chosen, tell)


def _check(
    parameters: FlatParameters, cost: Cost, method: AbstractGradientMethod, tolerance: float, chosen: dict[str, Any],
    tell: Callable[[str], None],
) -> GradientCheck:  # fmt: skip
    """The check in the order of its tests; `tell` hears which one is being made."""
    reverse, reported = _gradient(parameters, cost, method, chosen)
    tell("compiling forward sensitivities")
    forward, _ = _gradient(parameters, cost, ForwardSensitivities(), chosen)
    tell("differences")
    value = value_with_calls(parameters, cost, chosen)
    J, calls = value(parameters.vector)
    _must_be_numbers(parameters, float(J))
    scale = _scale(parameters.vector, float(J), reverse)
    nearby = on_sequence(value, calls)
    found = best_finite_differences(nearby, parameters.vector, scale)
    size = _size(reverse, forward, scale, slopes_nearby(nearby, parameters.vector, scale))
    # Where nothing moves J, it may be near 0 (a body at rest) and have the rounding of the motion that led there.
    largest = np.where((reverse == 0) & (forward == 0), max(abs(float(J)), largest_state(calls)), abs(float(J)))
    rounding = rounding_of_slopes(largest, scale, parameters.vector.dtype).tolist()
    counts = [int(call.events.count) for call in calls]
    tell("compiling the reference")
    reference = reference_gradient(parameters, cost, chosen, counts)
    slopes = np.stack([reverse, forward, found.slopes, found.uncertainty, reference], axis=1).tolist()
    limits = (tolerance * size).tolist()
    checks = []
    for name, found_by, limit, noise in zip(parameters.names, slopes, limits, rounding, strict=True):
        entry = ParameterCheck(name, *found_by, verdict="")
        checks.append(entry._replace(verdict=_verdict(entry, limit, noise)))
    tell("looking at both sides")
    least_jump = (tolerance * size * scale + ROUNDING_OF_J * largest).tolist()
    vector = np.asarray(parameters.vector)
    for i, (entry, limit, noise) in enumerate(zip(checks, limits, rounding, strict=True)):
        moved, verdict = (i, float(scale[i])), entry.verdict
        if not verdict:
            side = other_side(value, float(J), calls, vector, moved)
            verdict = one_sided(side, entry.adjoint, limit, least_jump[i])
        # At a kink the methods, the reference and differences may each have another one of the slopes on both sides.
        kink = kink_at(nearby, vector, moved, LEAST_KINK * (limit + noise))
        checks[i] = entry._replace(verdict=kinked(kink, (entry.adjoint, entry.forward), limit) or verdict)
    tell("checking each event")
    knows_contacts = lambda call: isinstance(call.scene, AbstractScene) and not has_switches(call.scene)
    mechanical = [(number, call) for number, call in enumerate(calls) if knows_contacts(call)]
    events = [check for number, call in mechanical for check in check_events(number, call, tolerance, chosen)]
    tell("looking for causes")
    said = zip(calls, reported.status, reported.doubt_time, strict=True)  # of the motions where a derivative is taken
    calls = [call._replace(status=status, doubt_time=time) for call, status, time in said]
    off = _resolved(checks, limits, lambda: resolved_gradient(parameters, cost, chosen, counts))
    causes = find_causes(checks, events, calls, off, chosen)
    tell("compiling the adjoint at the default tolerance")
    default = at_default(parameters, cost, method, chosen, reverse, size)
    return GradientCheck(tuple(checks), tuple(events), causes, default)


def _must_be_numbers(parameters: FlatParameters, J: float) -> None:
    """Raises: ValueError for a parameter or a J that is not finite, of which nothing can be checked."""
    bad = [name for name, value in zip(parameters.names, parameters.vector, strict=True) if not np.isfinite(value)]
    if bad:
        raise ValueError(f"All parameters must be finite, but {', '.join(bad)} {'is' if len(bad) == 1 else 'are'} not.")
    if not np.isfinite(J):
        raise ValueError(f"`cost` must return a finite number, but returns {J}: look at what it makes of the motion.")


def _resolved(checks, limits: list[float], resolve: Callable) -> dict[str, bool]:
    """The parameters that are off the reference, and whether the gradient's steps resolve the derivative there.

    They do where shorter steps of the same motion leave the gradient as it is.
    """
    entries = list(zip(checks, limits, strict=True))
    in_doubt = lambda entry: entry.verdict and not entry.verdict.startswith(KINK)
    off = [k for k, (entry, limit) in enumerate(entries) if in_doubt(entry) and _off(entry, entry.reference, limit)]
    if not off:
        return {}
    right = resolve().tolist()  # nan where that took too many steps
    return {checks[k].parameter: not (np.isnan(right[k]) or _off(checks[k], right[k], limits[k])) for k in off}


def _off(entry: ParameterCheck, right: float, limit: float) -> bool:
    """Whether one of the two exact methods is off what should be right; nan, for want of steps, is."""
    return any(np.isnan(slope) or abs(slope - right) > limit for slope in (entry.adjoint, entry.forward))


def _gradient(parameters: FlatParameters, cost: Cost, adjoint: AbstractGradientMethod, settings):
    _, gradient, reported = gradient_by(adjoint, parameters, cost, settings, QUICKLY)
    raise_unless_reached_end(reported)
    return np.asarray(gradient), reported


def _scale(vector, J: float, gradient):
    """How far each parameter is moved: by a part of itself, or of what changes J by as much as J itself.

    A J with a large constant in it would move a parameter of value 0 too far: not farther than 1, or than what changes
    J by as much as the other parameters do."""
    slope, moved = np.abs(gradient), np.asarray(vector) != 0
    effect = np.max(slope[moved] * np.abs(vector)[moved], initial=0)
    natural, others = (np.where(slope > 0, size / np.where(slope > 0, slope, 1), 1.0) for size in (abs(J), effect))
    natural = np.fmin(natural, np.fmax(others, 1.0))
    # A J that is 0 by symmetry is so but for rounding.
    return np.where(moved, np.abs(vector), np.where(natural > 1e-8, natural, 1.0))


def _size(adjoint, forward, scale, nearby):
    """What a deviation of an entry is measured by: the entry itself, a thousandth of the whole gradient's effect, or
    the slope that J has nearby, since at a minimum all entries are 0 but for the error of the motion."""
    largest = np.max(np.abs(adjoint) * scale)
    return np.fmax.reduce([np.abs(adjoint), np.abs(forward), 1e-3 * largest / scale, nearby])


ROUNDING_OF_J = 1e-9
"""Two motions that differ by an event alone have the same J but for this part of the largest number in them."""
LEAST_KINK = 10
"""A kink turns the slope by so many times what a deviation may be."""
ALIKE = 1e-2
"""The two exact methods may differ by this part of the tolerance: each resolves its steps to tolerances that know
nothing of the size of a cost."""


def _verdict(entry: ParameterCheck, limit: float, rounding: float) -> str:
    apart = abs(entry.adjoint - entry.forward)
    if not apart <= ALIKE * limit:
        return f"adjoint and forward sensitivities disagree by {apart:.1e}"
    if abs(entry.adjoint - entry.reference) > limit:  # False where there is none
        return "the reference disagrees"
    if np.isnan(entry.differences):
        return f"{UNDECIDED}: the sequence of events changes within the smallest differences"
    distance = abs(entry.adjoint - entry.differences)
    if distance <= limit + rounding:
        return ""
    if distance <= 3 * entry.uncertainty:
        return f"{UNDECIDED}: differences are uncertain by {entry.uncertainty:.1e}"
    return "differences disagree"


TIGHTER = 1e-3
"""How much better than by default a step must resolve the derivative here."""
FINEST = 4096
"""Roundings: no step is asked to be better than this many."""


def tight_replay(rtol: float, dtype) -> Replay:
    """A replay with `TIGHTER` error control of the derivative; `rtol` is that of the motion."""
    default = min(100 * rtol, max(1e-5, rtol))
    return Replay(rtol=max(TIGHTER * default, FINEST * float(jnp.finfo(dtype).eps)))


def resolved_gradient(parameters: FlatParameters, cost: Cost, settings: dict[str, Any], counts: list[int]):
    """The gradient on the motion that is given, with its derivative resolved to `tight_replay`.

    nan where the steps do not suffice for that, or where the motions do not have the given numbers of events.
    """
    method = tight_replay(settings["rtol"], parameters.vector.dtype)
    _, gradient, reported = gradient_by(method, parameters, cost, settings, QUICKLY)
    same = all_reached_end(reported) and [int(count) for count in reported.count] == counts
    return np.asarray(gradient) if same else np.full(parameters.vector.shape, np.nan)


def reference_gradient(
    parameters: FlatParameters, cost: Cost, settings: dict[str, Any], counts: list[int]
) -> Float[np.ndarray, "parameter"]:
    """The same on a motion by another solver, of order 8, with tolerances ten times tighter.

    It shares neither the steps nor the error estimate of the gradient that is checked.
    """
    finest = 256 * float(jnp.finfo(parameters.vector.dtype).eps)
    rtol, atol = (min(settings[name], max(0.1 * settings[name], finest)) for name in ("rtol", "atol"))
    tighter = settings | dict(solver=diffrax.Dopri8(), rtol=rtol, atol=atol)
    return resolved_gradient(parameters, cost, tighter, counts)
