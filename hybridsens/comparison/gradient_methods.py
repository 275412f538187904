"""The rows of a comparison: each a way to move the scene and a way to differentiate the result."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx

from ..adjoint.methods import (
    AbstractGradientMethod,
    ContinuousCostate,
    DiffraxAdjoint,
    ForwardSensitivities,
    Replay,
)
from ..mechanics.switches import has_switches
from .baselines import (
    constant_event_time,
    events_at_root,
    events_at_step_end,
    penalty_contact,
    where_reset,
    where_transition,
)
from .differentiate import Mode
from .move import move


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
    mode: Mode = "forward" if isinstance(adjoint, ForwardSensitivities) else "reverse"
    bound = partial(move, adjoint=adjoint, throw=False, **settings)
    return GradientMethod(type(adjoint).__name__, bound, mode)


def adjoint_name(adjoint: AbstractGradientMethod) -> str:
    """The class and those of its settings that are not the default: `Replay`, `ContinuousCostate(rtol=1e-10)`."""
    default = type(adjoint)()
    fields = {name: getattr(adjoint, name) for name in adjoint.__dataclass_fields__}
    changed = [f"{name}={value!r}" for name, value in fields.items() if value != getattr(default, name)]
    return type(adjoint).__name__ + (f"({', '.join(changed)})" if changed else "")


def at_tolerance(adjoint: AbstractGradientMethod, tolerance) -> AbstractGradientMethod:
    """A continuous costate with its default tolerances gets those of the motion; all others stay as they are."""
    default = ContinuousCostate()
    if not isinstance(adjoint, ContinuousCostate) or (adjoint.rtol, adjoint.atol) != (default.rtol, default.atol):
        return adjoint
    return eqx.tree_at(lambda method: (method.rtol, method.atol), adjoint, (tolerance, tolerance))


def our_methods(
    adjoints: Sequence[AbstractGradientMethod], tolerance: float, max_events: int, max_steps: int
) -> list[GradientMethod]:
    """This package's methods, at one tolerance for the motion and for what is integrated back."""
    settings = dict(rtol=tolerance, atol=tolerance, max_events=max_events, max_steps=max_steps)
    methods = [from_adjoint(at_tolerance(adjoint, tolerance), **settings) for adjoint in adjoints]
    return [m._replace(name=adjoint_name(adjoint)) for m, adjoint in zip(methods, adjoints, strict=True)]


def differences(tolerance: float, max_events: int, max_steps: int) -> GradientMethod:
    """Central differences of our own motions."""
    settings = dict(rtol=tolerance, atol=tolerance, max_events=max_events, max_steps=max_steps)
    return GradientMethod("central differences", partial(move, throw=False, **settings), "differences")


def naive_methods_of_systems(steps: int) -> list[GradientMethod]:
    """What one would write for a hybrid system without this package: steps of fixed size."""
    return [GradientMethod("autodiff, `where` transition", partial(where_transition, steps=steps), "reverse")]


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
    return run(scene, state, **settings)
