"""One point of a sweep: its value, its gradient, its status, and what its events were."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..export.trees import leaves_by_name
from ..mechanics.events import Events
from ..mechanics.mode import EventKind
from ..mechanics.trajectory import Trajectory
from ..parameters import parameters, replace
from ..solution import Solution
from ..status import Status
from ..validation.asked import Asked

NOT_COMPUTED = -1
"""Status of a point that a store has room for and that has not been reached yet."""


class Wanted(NamedTuple):
    """What is written down for each point."""

    gradient: tuple[str, ...]
    """Parameters that J is differentiated by."""
    events: int
    """How many of the first events are written down one by one."""
    states: bool
    """Whether the states at the times asked for are kept."""


def evaluate(cost: Callable, scene: Any, wanted: Wanted, columns: dict[str, Any]) -> dict[str, Any]:
    """Everything about one point, by the names that the Dataset has.

    Values of a point that failed are NaN; at a grazing point the gradient is, since it does not exist there.
    Raises TypeError or ValueError, while it is traced, for a cost that a sweep cannot use.
    """
    j, trajectory, gradient = _differentiate(cost, replace(scene, columns), wanted)
    status = _status(j, trajectory, gradient)
    smooth, reached = status == Status.successful, status.reached_end
    out = {"J": jnp.where(reached, j, jnp.nan)}
    out |= {f"dJ_d{name}": jnp.where(smooth, d, jnp.nan) for name, d in gradient.items()}
    if trajectory is not None:
        out |= _event_summary(trajectory, wanted.events)
        if wanted.states:
            out |= {name: jnp.where(reached, rows, jnp.nan) for name, rows in _samples(trajectory).items()}
    return out | {"status": jnp.asarray(status.code, jnp.int8)}


def _differentiate(cost, scene, wanted: Wanted) -> tuple[Any, Any, dict[str, Any]]:
    """J, the trajectory (or None), and the gradient by name."""
    chosen = {name: parameters(scene)[name] for name in wanted.gradient}

    def value(chosen):
        j, trajectory = _value_and_trajectory(Asked("cost(scene)", cost)(replace(scene, chosen)), wanted)
        return j, (j, trajectory)

    if not chosen:
        return *value(chosen)[1], {}
    gradient, (j, trajectory) = jax.grad(value, has_aux=True)(chosen)
    return j, trajectory, gradient


def _status(j, trajectory, gradient) -> Status:
    """The motion's status; a success whose value or gradient is not finite after all is none."""
    finite = jnp.all(jnp.isfinite(jnp.concatenate([jnp.ravel(d) for d in (j, *gradient.values())])))
    if trajectory is None:
        return Status.where(finite, Status.successful, Status.non_finite)
    status = trajectory.status
    return Status.where((status == Status.successful) & ~finite, Status.cost_not_finite, status)


def _value_and_trajectory(out, wanted: Wanted):
    """What the cost returned, checked while it is traced."""
    j, trajectory = out if isinstance(out, tuple) and len(out) == 2 else (out, None)
    shape, dtype = getattr(j, "shape", None), getattr(j, "dtype", None)
    if shape != () or dtype is None or not jnp.issubdtype(dtype, jnp.floating):
        found = f"{type(j).__name__}" if shape is None else f"{dtype} of shape {shape}"
        remedy = ": return (J, motion), with a number J of it" if isinstance(j, Trajectory | Solution) else ""
        raise ValueError(f"The cost must have a real scalar as its value, but has {found}{remedy}.")
    if trajectory is not None and not isinstance(trajectory, Trajectory | Solution):
        raise TypeError(
            "The cost must return J, or (J, motion) with what `simulate` or `solve` returned, but returns "
            f"(J, {type(trajectory).__name__})."
        )
    if trajectory is not None and trajectory.events.count.shape != ():
        raise ValueError(f"The trajectory must be one motion, but has the batch shape {trajectory.events.count.shape}.")
    if wanted.states and (trajectory is None or trajectory.ts is None):
        raise ValueError(
            "With states=True the cost must return (J, trajectory), where the trajectory has times `ts`; it has not."
        )
    return j, trajectory


def _samples(motion: Trajectory | Solution) -> dict[str, Any]:
    """The times asked for and the states there: q and v, or the leaves of x by their names."""
    if isinstance(motion, Trajectory):
        return {"sample_time": motion.ts, "q": motion.q, "v": motion.v}
    return {"sample_time": motion.ts} | leaves_by_name("x", motion.x)


def _event_summary(motion: Trajectory | Solution, kept: int) -> dict[str, Any]:
    events = motion.events
    happened = jnp.arange(events.time.shape[0]) < events.count
    if isinstance(events, Events):
        own = _of_contacts(events, happened, kept)
    else:
        own = {"event_guard": events.guard[:kept].astype(jnp.int32)}
    return own | {
        "event_count": events.count.astype(jnp.int32),
        "event_sequence": events.sequence,
        "steps": (motion.steps.accepted + motion.steps.rejected).astype(jnp.int32),
        "event_time": jnp.where(happened, events.time, jnp.nan)[:kept],
    }


def _of_contacts(events: Events, happened, kept: int) -> dict[str, Any]:
    strikes = (events.kind == EventKind.IMPACT) | (events.kind == EventKind.CAPTURE)
    struck = happened & strikes & ~_dies_away(events, happened)
    margin = jnp.min(jnp.where(struck, events.closing_speed, jnp.inf), initial=jnp.inf)
    return {
        "grazing_margin": jnp.where(jnp.any(struck), margin, jnp.nan),
        "event_kind": events.kind[:kept].astype(jnp.int8),
        "event_contact": events.contact[:kept].astype(jnp.int32),
    }


def _dies_away(events, happened):
    """Which events are the end of a cascade, from after its fastest impact on up to its capture: slow by those before
    them, and no sign that a contact is nearly missed."""
    row, (kind, contact, speed) = jnp.arange(happened.size), (events.kind, events.contact, events.closing_speed)
    same = happened & (contact[:, None] == contact)
    ends = happened & ((kind == EventKind.CAPTURE) | (kind == EventKind.RELEASE))
    flight = jnp.sum(same & ends & (row < row[:, None]), axis=1)
    cascade = same & (flight[:, None] == flight)
    captured = jnp.any(cascade & (kind == EventKind.CAPTURE), axis=1)
    fast = speed >= (1 - 1e-3) * jnp.max(jnp.where(cascade, speed, 0), axis=1, initial=0)
    return captured & ~jnp.any(cascade & fast & (row >= row[:, None]), axis=1)
