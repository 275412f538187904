"""Which entry of the state a column of data is, by its name."""

import re
from collections.abc import Sequence
from typing import Any

from ..export.names import coordinate_names
from ..mechanics.scene import State
from .motions import state_names

_WITH_UNIT = re.compile(r"(.+?)\s+\[(.*)\]")


def split_unit(name: str) -> tuple[str, str | None]:
    """("height", "m") of "height [m]"; ("q[0]", None) of what has no unit behind a space."""
    found = _WITH_UNIT.fullmatch(name)
    return (name, None) if found is None else (found[1], found[2])


def picks(columns: Sequence[str], scene: Any, start: tuple) -> tuple[int, ...]:
    """Which entries of the state the columns are: by the names of the state, or by the scene's own `coordinates`.

    Raises: ValueError for a column that has no such name, that of two entries, or a unit which is not the scene's."""
    state, own = start[0], []
    if isinstance(state, State) and getattr(scene, "coordinates", None) is not None:
        own = [name for names in coordinate_names(scene, state.q.shape[0]) for name in names]
    return tuple(_pick(column, state_names(start), own, isinstance(state, State)) for column in columns)


def _pick(column: str, known: list[str], own: list[str], mechanical: bool) -> int:
    name, unit = split_unit(column)
    spelt = {"q": "q0", "v": "v0"}.get(name, re.sub(r"[\[\]_]", "", name)) if mechanical else name
    alike = lambda names, wanted: {i for i, other in enumerate(names) if other == wanted}
    places = alike(known, spelt) | alike([split_unit(other)[0] for other in own], name)
    if len(places) != 1:
        two = ", which names two entries" if places else ""
        raise ValueError(
            f"Without `observe`, columns must be named after the state ({_choices(known, own)}), but there is "
            f"{column!r}{two}. Choose among them with `columns`, or say with `observe` what was measured."
        )
    (place,) = places
    _check_unit(column, unit, own[place] if own else "")
    return place


def _check_unit(column: str, unit: str | None, own: str) -> None:
    expected = split_unit(own)[1]
    if None not in (unit, expected) and unit != expected:
        raise ValueError(
            f"Column {column!r} must be in the scene's unit, which names it {own!r}, but is in {unit}. Convert it, and "
            "rename it."
        )


def _choices(known: list[str], own: list[str]) -> str:
    shown = ", ".join(known) if len(known) <= 8 else f"{known[0]} ... {known[-1]}"
    return shown + (f"; or {', '.join(own[:8])}{', ...' if len(own) > 8 else ''}" if own else "")
