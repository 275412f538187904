"""The rows of a comparison: each a way to move the scene and a way to differentiate the result."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..adjoint.methods import (
    AbstractGradientMethod,
    ContinuousCostate,
    DiffraxAdjoint,
    ForwardSensitivities,
    Replay,
)
from ..mechanics.switches import has_switches
from ..parameters import FlatParameters
from .baselines import (
    constant_event_time,
    events_at_root,
    events_at_step_end,
    penalty_contact,
    where_reset,
    where_transition,
)
from .differentiate import Mode, value_and_gradient
from .functional import CallReport, Cost, functional, move, told_of_the_cost


class GradientMethod(NamedTuple):
    """One way to get a gradient."""

    name: str
    simulate: Callable[..., Any]
    """What the cost is given as `simulate`."""
    mode: Mode
    """How the cost is then differentiated."""


DEFAULT_ADJOINTS: tuple[AbstractGradientMethod, ...] = (
    Replay(),
    ForwardSensitivities(),
    ContinuousCostate(),
    ContinuousCostate(state="backward"),
    DiffraxAdjoint(),
)
"""The gradient methods of this package that a comparison shows."""


def from_adjoint(adjoint: AbstractGradientMethod, **settings) -> GradientMethod:
    """A gradient method of `hybridsens.simulate` and `hybridsens.solve`; `settings` go to them."""
    mode: Mode = "reverse" if adjoint.reverse_mode else "forward"
    bound = partial(move, adjoint=adjoint, throw=False, **settings)
    return GradientMethod(type(adjoint).__name__, bound, mode)


def gradient_by(
    adjoint: AbstractGradientMethod, parameters: FlatParameters, cost: Cost, settings: Mapping[str, Any], options=None
) -> tuple[Any, Any, CallReport]:
    """J, dJ/dtheta and what the motions report, by a method of this package; `options` are those of the compiler."""
    method = from_adjoint(adjoint, **settings)
    run = value_and_gradient(functional(parameters, cost, method.simulate), method.mode, options=options)
    with told_of_the_cost():
        return run(parameters.vector)


def gradient_at_tolerances(
    adjoint: AbstractGradientMethod, parameters: FlatParameters, cost: Cost, settings: Mapping[str, Any]
) -> Callable[..., tuple[Any, Any, CallReport]]:
    """(vector, tolerance) -> J, dJ/dtheta and what the motions report: one program for all tolerances."""

    @jax.jit
    def gradient(vector, tolerance):
        tolerance = jnp.asarray(tolerance, vector.dtype)
        method = from_adjoint(adjoint.at_tolerance(tolerance), **{**settings, "rtol": tolerance, "atol": tolerance})
        return value_and_gradient(functional(parameters, cost, method.simulate), method.mode)(vector)

    return gradient


def name_with_settings(method: Any) -> str:
    """The class of a gradient method or a solver, and those of its settings that are not the default: `Replay`,
    `ContinuousCostate(rtol=1e-10)`."""
    fields = {field.name: (getattr(method, field.name), field) for field in dataclasses.fields(method)}
    changed = [f"{name}={value!r}" for name, (value, field) in fields.items() if value != _default(field)]
    return " ".join((type(method).__name__ + (f"({', '.join(changed)})" if changed else "")).split())


def _default(field: dataclasses.Field) -> Any:
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def our_methods(adjoints: Sequence[AbstractGradientMethod], settings: Mapping[str, Any]) -> list[GradientMethod]:
    """This package's methods, at one tolerance for the motion and for what is integrated back."""
    methods = [from_adjoint(adjoint.at_tolerance(settings["rtol"]), **settings) for adjoint in adjoints]
    return [m._replace(name=name_with_settings(adjoint)) for m, adjoint in zip(methods, adjoints, strict=True)]


def differences(settings: Mapping[str, Any]) -> GradientMethod:
    """Central differences of our own motions."""
    return GradientMethod("central differences", partial(move, throw=False, **settings), "differences")


def naive_methods_of_systems(steps: int) -> list[GradientMethod]:
    """What one would write for a hybrid system without this package: steps of fixed size."""
    run = partial(_to_t1, partial(where_transition, steps=steps))
    return [GradientMethod("autodiff, `where` transition", run, "reverse")]


def naive_methods(tolerance: float, steps: int, room: int) -> list[GradientMethod]:
    """What one would write for a mechanical scene. `steps`: of fixed size; `room`: for events in a chain of solves."""
    chain = dict(tolerance=tolerance, max_events=room)
    rows = [
        GradientMethod("autodiff, events with root finder", partial(events_at_root, **chain), "reverse"),
        GradientMethod("autodiff, events at step ends", partial(events_at_step_end, **chain), "reverse"),
        GradientMethod("autodiff, event times constant", partial(constant_event_time, **chain), "reverse"),
        GradientMethod("autodiff, `where` reset", partial(where_reset, steps=steps), "reverse"),
        GradientMethod("autodiff, penalty contact", partial(penalty_contact, steps=steps), "reverse"),
    ]
    return [row._replace(simulate=partial(_of_contacts, row.simulate)) for row in rows]


def _of_contacts(run: Callable[..., Any], scene: Any, state: Any, *mode: Any, **settings: Any) -> Any:
    """A motion by a method that knows no other events. Raises: NotImplementedError for a scene with switches."""
    if has_switches(scene) or mode:
        raise NotImplementedError("this method knows impacts alone, but the scene has switches of its own")
    return _to_t1(run, scene, state, **settings)


def _to_t1(run: Callable[..., Any], *start: Any, until: Any = None, **settings: Any) -> Any:
    """A motion by a method that always goes on to t1. Raises: NotImplementedError for one that ends with an event."""
    if until is not None:
        raise NotImplementedError("this method goes on to t1, and cannot end with an event")
    return run(*start, **settings)
