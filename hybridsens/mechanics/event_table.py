"""The events of a motion as lines and rows of text, and what the values of a motion show that did not reach its end."""

from typing import Any

import jax
import jax.core
import lineax as lx
import numpy as np

from ..export.names import contact_names, names_of_events
from ..export.text import array_text, rows_shown
from ..export.trees import as_text
from ..validation.not_finite import not_finite_among
from .mass import is_symmetric
from .mode import EventKind
from .scene import AbstractScene, State


def event_rows(events: Any):
    """A header and a row for each event, as texts."""
    yield ["event", "time", "kind", "contact", "closing speed", "impulse", "state after"]
    names = _contacts(events)
    for j in range(int(events.count)):
        kind = EventKind(int(events.kind[j])).name.lower()
        yield [
            str(j), f"{float(events.time[j]):.9f}", kind, names[j], f"{float(events.closing_speed[j]):.6g}",
            f"{impulse_of(events, j):.6g}", _after(events, j),
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

    def row(j: int) -> str:
        kind = EventKind(int(events.kind[j])).name.lower()
        after, speed = _after(events, j), float(events.closing_speed[j])
        return (
            f"{j:>5} {float(events.time[j]):>14.9f} {kind:>8} {names[j]:>{wide}} {speed:>14.6g} "
            f"{impulse_of(events, j):>12.6g}  {after}{' *' if events.order_matters[j] else ''}"
        )

    yield from rows_shown(count, row)
    if np.any(events.order_matters[:count]):
        yield (
            "* Contacts that act on each other, here or for other parameters, were met at the same instant. Another "
            "order of their impacts has another outcome, so derivatives of what follows are one-sided at best."
        )


def _contacts(events: Any) -> list[str]:
    """The contact or the switch of each event that happened: its name where the scene is known and names it."""
    numbers, kinds = (np.asarray(rows[: int(events.count)]) for rows in (events.contact, events.kind))
    scene, contacts = getattr(events, "_scene", None), np.shape(events.impulse)[-1]
    return names_of_events(scene, numbers, kinds == EventKind.SWITCH, contacts)


def impulse_of(events: Any, j: int) -> float:
    """Impulse of the contact that an event is of; 0 at a switch."""
    return 0.0 if events.kind[j] == EventKind.SWITCH else float(events.impulse[j, int(events.contact[j])])


def _after(events: Any, j: int) -> str:
    """The state after an event, and the mode of a scene that has some."""
    state = state_text(State(events.after.q[j], events.after.v[j]))
    return state if events.mode is None else f"{state}; {as_text(jax.tree.map(lambda leaf: leaf[j], events.mode))}"


def state_text(state: State) -> str:
    """A state in a line: "q = [0.6], v = [-0.276377]"."""
    return f"q = {array_text(state.q)}, v = {array_text(state.v)}"


def shown_by_values(scene: AbstractScene, state: State, horizon: tuple, motion: Any) -> str:
    """An end to the message of a motion that did not reach its end; "" in a batch, and while values are traced.

    `horizon` is (t0, t1, ts)."""
    given = jax.tree.leaves((scene, state, horizon, motion))
    if any(isinstance(leaf, jax.core.Tracer) for leaf in given) or np.ndim(motion.events.count) > 0:
        return ""
    t0, *_ = horizon
    told = {
        "penetration": lambda: _of_contact("gap", scene, scene.gap(t0, state.q), np.argmin),
        "bad_restitution": lambda: _of_contact("restitution", scene, scene.restitution(), _worst_restitution),
        "bad_mass_matrix": lambda: _of_mass(scene, motion.final.q),
        "step_size_underflow": lambda: _of_singular_mass(scene, state.q, motion.final.q) or _last_events(motion),
        "event_repeats": lambda: _impacts_accumulate(scene) + _last_events(motion),
        "non_finite": lambda: not_finite_among(scene, state) or _last_events(motion),
    }
    text = told.get(motion.status.name, lambda: _last_events(motion))()
    return f" {text}" if text else ""


def _impacts_accumulate(scene: AbstractScene) -> str:
    return "" if scene.sustained_contact else "The scene sets `sustained_contact = False`: set it to True. "


def _of_contact(what: str, scene: AbstractScene, values, pick) -> str:
    values = np.asarray(values)
    worst = int(pick(values))
    name = contact_names(scene, len(values))[worst]
    return f"The {what} of contact {name} is {values[worst]:.6g}."


def _worst_restitution(e) -> int:
    return int(np.argmax(~((e >= 0) & (e <= 1))))


def _of_mass(scene: AbstractScene, q) -> str:
    """Which entries are not symmetric, or the eigenvalue that is not positive."""
    matrix = _matrix(scene, q)
    if not np.all(np.isfinite(matrix)):
        return ""
    where = f"At q = {array_text(q)}"
    if not is_symmetric(matrix, matrix.T):
        i, j = np.unravel_index(np.argmax(abs(matrix - matrix.T)), matrix.shape)
        return f"{where} M[{i}, {j}] is {matrix[i, j]:.6g} and M[{j}, {i}] is {matrix[j, i]:.6g}."
    return f"{where} its smallest eigenvalue is {np.linalg.eigvalsh(matrix)[0]:.6g}."


def _of_singular_mass(scene: AbstractScene, q0, q) -> str:
    """Eigenvalues of a mass matrix that has come far nearer to a singular one than it was; "" for another."""
    (low0, high0), (low, high) = (np.linalg.eigvalsh(_matrix(scene, at))[[0, -1]] for at in (q0, q))
    if not low / high < 1e-3 * (low0 / high0):
        return ""
    return f"At q = {array_text(q)} the mass matrix is all but singular, with eigenvalues from {low:.3g} to {high:.3g}."


def _matrix(scene: AbstractScene, q) -> np.ndarray:
    mass = scene.mass_matrix(q)
    return np.asarray(mass.as_matrix() if isinstance(mass, lx.AbstractLinearOperator) else mass)


def _last_events(motion: Any, shown: int = 3) -> str:
    _, *rows = event_rows(motion.events)
    told = "; ".join(f"t = {time}, {kind} of {contact}" for _, time, kind, contact, *_ in rows[-shown:])
    return f"The last events: {told}." if told else ""
