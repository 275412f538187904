"""The rows of a comparison: each a way to move the scene and a way to differentiate the result."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from ..adjoint.methods import AbstractGradientMethod, ForwardSensitivities, Replay
from ..simulate import simulate
from .baselines import constant_event_time, events_at_root, events_at_step_end, penalty_contact, where_reset
from .differentiate import Mode


class GradientMethod(NamedTuple):
    """One way to get a gradient."""

    name: str
    simulate: Callable[..., Any]
    """What the cost is given as `simulate`."""
    mode: Mode
    """How the cost is then differentiated."""


def from_adjoint(adjoint: AbstractGradientMethod, **settings) -> GradientMethod:
    """A gradient method of `hybridsens.simulate`; `settings` go to it."""
    mode: Mode = "forward" if isinstance(adjoint, ForwardSensitivities) else "reverse"
    return GradientMethod(adjoint_name(adjoint), partial(simulate, adjoint=adjoint, throw=False, **settings), mode)


def adjoint_name(adjoint: AbstractGradientMethod) -> str:
    """The class and those of its settings that are not the default: `Replay`, `Replay(recompute=True)`."""
    default = type(adjoint)()
    fields = {name: getattr(adjoint, name) for name in adjoint.__dataclass_fields__}
    changed = [f"{name}={value}" for name, value in fields.items() if value != getattr(default, name)]
    return type(adjoint).__name__ + (f"({', '.join(changed)})" if changed else "")


DEFAULT_ADJOINTS: tuple[AbstractGradientMethod, ...] = (Replay(), ForwardSensitivities())
"""The gradient methods of this package that a comparison shows."""


def our_methods(
    adjoints: Sequence[AbstractGradientMethod], tolerance: float, max_events: int, max_steps: int
) -> list[GradientMethod]:
    """This package's methods, at one tolerance for motion and error control."""
    settings = dict(rtol=tolerance, atol=tolerance, max_events=max_events, max_steps=max_steps)
    return [from_adjoint(adjoint, **settings) for adjoint in adjoints]


def naive_methods(tolerance: float, steps: int, room: int, max_events: int, max_steps: int) -> list[GradientMethod]:
    """What one would write without this package. `steps`: of fixed size; `room`: for events in a chain of solves."""
    chain = dict(tolerance=tolerance, max_events=room)
    motion = partial(
        simulate, throw=False, rtol=tolerance, atol=tolerance, max_events=max_events, max_steps=max_steps
    )
    return [
        GradientMethod("autodiff, events with root finder", partial(events_at_root, **chain), "reverse"),
        GradientMethod("autodiff, events at step ends", partial(events_at_step_end, **chain), "reverse"),
        GradientMethod("autodiff, event times constant", partial(constant_event_time, **chain), "reverse"),
        GradientMethod("autodiff, `where` reset", partial(where_reset, steps=steps), "reverse"),
        GradientMethod("autodiff, penalty contact", partial(penalty_contact, steps=steps), "reverse"),
        GradientMethod("central differences", motion, "differences"),
    ]
