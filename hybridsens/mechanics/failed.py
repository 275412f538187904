"""What the values of a motion show that did not reach its end, where they can be seen."""

import jax
import jax.core
import numpy as np

from ..export.names import contact_names
from ..status import Status
from .event_table import event_rows
from .scene import AbstractScene, State
from .trajectory import Trajectory


def shown_by_values(scene: AbstractScene, state: State, horizon: tuple, motion: Trajectory) -> str:
    """An end to the message of a motion that did not reach its end; "" in a batch, and while values are traced.

    `horizon` is (t0, t1, ts)."""
    given = jax.tree.leaves((scene, state, horizon, motion))
    if any(isinstance(leaf, jax.core.Tracer) for leaf in given) or np.ndim(motion.events.count) > 0:
        return ""
    t0, t1, ts = horizon
    told = {
        "penetration": lambda: _of_contact("gap", scene, scene.gap(t0, state.q), np.argmin),
        "bad_restitution": lambda: _of_contact("restitution", scene, scene.restitution(), _worst_restitution),
        "bad_horizon": lambda: f"Here t0 is {t0:.9g} and t1 is {t1:.9g}.",
        "unsorted_times": lambda: _time_in_the_way(ts, t0, t1),
    }
    text = told.get(Status.names()[int(motion.status.code)], lambda: _last_events(motion))()
    return f" {text}" if text else ""


def _of_contact(what: str, scene: AbstractScene, values, pick) -> str:
    values = np.asarray(values)
    worst = int(pick(values))
    name = contact_names(scene, len(values))[worst]
    return f"The {what} of contact {name} is {values[worst]:.6g}."


def _worst_restitution(e) -> int:
    return int(np.argmax(~((e >= 0) & (e <= 1))))


def _time_in_the_way(ts, t0, t1) -> str:
    ts = np.asarray(ts)
    wrong = ~((ts >= t0) & (ts <= t1)) | (np.diff(ts, prepend=ts[0]) < 0)
    first = int(np.argmax(wrong))
    return f"Here ts[{first}] is {ts[first]:.9g}, t0 is {t0:.9g} and t1 is {t1:.9g}."


def _last_events(motion: Trajectory, shown: int = 3) -> str:
    _, *rows = event_rows(motion.events)
    told = "; ".join(f"t = {time}, {kind} of {contact}" for _, time, kind, contact, *_ in rows[-shown:])
    return f"The last events: {told}." if told else ""
