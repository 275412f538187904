"""The events of a motion as lines and rows of text."""

from typing import Any

import jax
import numpy as np

from ..export.names import contact_names
from ..export.text import rows_shown
from ..export.trees import as_text
from .mode import EventKind
from .scene import State


def event_rows(events: Any):
    """A header and a row for each event, as texts."""
    yield ["event", "time", "kind", "contact", "closing speed", "impulse", "state after"]
    names = _contacts(events)
    for j in range(int(events.count)):
        kind = EventKind(int(events.kind[j])).name.lower()
        yield [
            str(j), f"{float(events.time[j]):.9f}", kind, names[j], f"{float(events.closing_speed[j]):.6g}",
            f"{_impulse(events, j):.6g}", _after(events, j),
        ]  # fmt: skip


def event_table(events: Any):
    """The same as lines in columns; of many events the first and the last."""
    count = int(events.count)
    if count == 0:
        return
    mode = "" if events.mode is None else "; mode"
    names = _contacts(events)
    wide = max(map(len, ["contact", *names]))
    numbers = f"{'event':>5} {'time':>14} {'kind':>8} {'contact':>{wide}} {'closing speed':>14} {'impulse':>12}"
    yield f"{numbers}  state{mode} after"
    for j in (shown := rows_shown(count)):
        if j is None:
            yield f"{'...':>5} ({count - len(shown) + 1} more)"
            continue
        kind = EventKind(int(events.kind[j])).name.lower()
        after, speed = _after(events, j), float(events.closing_speed[j])
        yield (
            f"{j:>5} {float(events.time[j]):>14.9f} {kind:>8} {names[j]:>{wide}} {speed:>14.6g} "
            f"{_impulse(events, j):>12.6g}  {after}{' *' if events.order_matters[j] else ''}"
        )
    if np.any(events.order_matters[:count]):
        yield (
            "* Contacts that act on each other, here or for other parameters, were met at the same instant. Another "
            "order of their impacts has another outcome, so derivatives of what follows are one-sided at best."
        )


def _contacts(events: Any) -> list[str]:
    """The contact of each event that happened: its name where the scene is known and names it, or its number; that of
    the switch at a switch."""
    names = contact_names(getattr(events, "_scene", None), np.shape(events.impulse)[-1])
    of = lambda j: int(events.contact[j])
    switch = lambda j: events.kind[j] == EventKind.SWITCH
    return [str(of(j)) if switch(j) else names[of(j)] for j in range(int(events.count))]


def _impulse(events: Any, j: int) -> float:
    """Impulse of the contact that an event is of; 0 at a switch."""
    return 0.0 if events.kind[j] == EventKind.SWITCH else float(events.impulse[j, int(events.contact[j])])


def _after(events: Any, j: int) -> str:
    """The state after an event, and the mode of a scene that has some."""
    state = state_text(State(events.after.q[j], events.after.v[j]))
    return state if events.mode is None else f"{state}; {as_text(jax.tree.map(lambda leaf: leaf[j], events.mode))}"


def state_text(state: State) -> str:
    with np.printoptions(precision=6, suppress=False):
        return f"q = {np.asarray(state.q)}, v = {np.asarray(state.v)}"
