"""What would be measured of a state: its own entries by name, or what a user's function makes of it, checked."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..export.names import coordinate_names, split_unit
from ..mechanics.scene import State
from ..validation.asked import Asked, kind_of
from .motions import entries, state_names


def picks(columns: Sequence[str], scene: Any, start: tuple) -> tuple[int, ...]:
    """Which entries of the state the columns are: by the names of the state, or by the scene's own `coordinates`.

    Raises: ValueError for a column that has no such name, that of two entries, that of an entry which another column
    is of, or a unit which is not the scene's."""
    state, own = start[0], []
    if isinstance(state, State) and getattr(scene, "coordinates", None) is not None:
        own = [name for names in coordinate_names(scene, state.q.shape[0]) for name in names]
    places = tuple(_pick(column, state_names(start), own, isinstance(state, State)) for column in columns)
    alike = [column for column, place in zip(columns, places, strict=True) if places.count(place) > 1]
    if alike:
        raise ValueError(
            f"Columns must be of different entries of the state, but {' and '.join(map(repr, alike))} are of one: it "
            "would count twice. Choose one of them with `columns`."
        )
    return places


def _pick(column: str, known: list[str], own: list[str], mechanical: bool) -> int:
    name, unit = split_unit(column)
    spelt = {"q": "q0", "v": "v0"}.get(name, re.sub(r"[\[\]_]", "", name)) if mechanical else name
    alike = lambda names, wanted: {i for i, other in enumerate(names) if split_unit(other)[0] == wanted}
    whole = not mechanical and column in known  # a key of x may have a unit, and name one entry by it
    places = {known.index(column)} if whole else alike(known, spelt) | alike(own, name)
    if len(places) != 1:
        two = ", which names two entries" if places else ""
        raise ValueError(
            f"Without `observe`, columns must be named after the state ({_choices(known, own)}), but there is "
            f"{column!r}{two}. Choose among them with `columns`, or say with `observe` what was measured."
            f"{'' if mechanical else _of_none([column])}"
        )
    (place,) = places
    _check_unit(column, unit, (own or known)[place], "scene" if mechanical else "system")
    return place


def _of_none(columns: Sequence[str]) -> str:
    """A sentence about names that nobody may have written: those of values without any."""
    if not all(re.fullmatch(r"q\d+", column) for column in columns):
        return ""
    return " Values without names are called q0, q1, ...: name them by `measurements(times, values, names=[...])`."


def _check_unit(column: str, unit: str | None, own: str, model: str) -> None:
    expected = split_unit(own)[1]
    if None not in (unit, expected) and unit != expected:
        raise ValueError(
            f"Column {column!r} must be in the {model}'s unit, which names it {own!r}, but is in {unit}. Convert it, "
            "and rename it."
        )


def _choices(known: list[str], own: list[str]) -> str:
    shown = ", ".join(known) if len(known) <= 8 else f"{known[0]} ... {known[-1]}"
    return shown + (f"; or {', '.join(own[:8])}{', ...' if len(own) > 8 else ''}" if own else "")


class StateObserver(eqx.Module):
    """Entries of (q, v), or of x. Hashable and comparable, so that a second fit of the same columns compiles
    nothing."""

    picks: tuple[int, ...] = eqx.field(static=True)

    def __call__(self, scene, t, *state):
        del scene, t
        return entries(state)[np.array(self.picks, int)]


class NamedObserver(eqx.Module):
    """An observation function with its result in the order of the columns."""

    function: Callable[..., Any] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, scene, t, *state):
        seen: Any = self.function(scene, t, *state)
        if isinstance(seen, Mapping):
            seen = [seen[key] for key in _keys(seen, self.names)]
        return jnp.stack([jnp.asarray(entry) for entry in seen]) if _is_list(seen) else jnp.atleast_1d(seen)


def observer(observe: Callable[..., Any] | None, scene, start: tuple, names: tuple[str, ...]) -> Callable[..., Any]:
    """The observation function, by default the scene's own method `observe`, checked against the columns.

    Raises: ValueError or TypeError if what it returns does not fit the columns.
    """
    own = observe is None and callable(getattr(scene, "observe", None))
    if not names:
        return StateObserver(())
    if observe is None and not own:
        return StateObserver(picks(names, scene, start))
    mechanical = isinstance(start[0], State)
    state = (start[0].q, start[0].v) if mechanical else (jax.tree.map(jnp.asarray, start[0]),)
    model, arguments = ("scene", "t, q, v") if mechanical else ("system", "t, x")
    asked = Asked.of(scene, f"observe({arguments})") if own else Asked(f"observe({model}, {arguments})", observe)
    seen = eqx.filter_eval_shape(asked, *(() if own else (scene,)), jnp.zeros(()), *state)
    if isinstance(seen, Mapping):
        _check_mapping(seen, names)
    elif _is_list(seen):
        _check_list(seen, names)
    else:
        _check_array(seen, names)
    return NamedObserver(_by_method if observe is None else observe, names)


def _by_method(scene, t, *state):
    return scene.observe(t, *state)


def _check_mapping(seen: Mapping, names: tuple[str, ...]) -> None:
    keys = _keys(seen, names)
    unknown = [name for name, key in zip(names, keys, strict=True) if key not in seen or keys.count(key) > 1]
    if unknown:
        raise ValueError(
            f"`observe` must return all columns {list(names)}, but has no {unknown}: it has {list(seen)}. "
            "Leave columns that are no measurements out of the data, by `read_measurements(data, columns=[...])`."
            f"{_of_none(unknown)}"
        )
    for name, key in zip(names, keys, strict=True):
        _check_scalar(name, seen[key])


def _keys(seen: Mapping, names: Sequence[str]) -> list[str]:
    """Under which names the columns are returned: their own, or those without their units."""
    bare = lambda name: split_unit(name)[0]
    return [bare(name) if name not in seen and bare(name) in seen else name for name in names]


def _check_list(seen: Any, names: tuple[str, ...]) -> None:
    if len(seen) != len(names):
        raise ValueError(
            f"`observe` must return one number for each of {list(names)}, but returns a {type(seen).__name__} of "
            f"{len(seen)}."
        )
    for name, entry in zip(names, seen, strict=True):
        _check_scalar(name, entry)


def _check_scalar(name: str, entry: Any) -> None:
    """A column of shape (1,) would be spread over all samples, in silence."""
    if _shape(entry) != ():
        raise ValueError(
            f"`observe` must return a scalar of shape () for the column {name!r}, but returns shape {_shape(entry)}. "
            "Choose an entry: q[0] in place of q."
        )


def _check_array(seen: Any, names: tuple[str, ...]) -> None:
    if seen is None:
        raise TypeError("`observe` must return what was measured, but returns None: is a `return` missing?")
    if _shape(seen) not in ((len(names),), () if len(names) == 1 else None):
        raise ValueError(f"`observe` must return shape ({len(names)},) for {list(names)}, but returns {_shape(seen)}.")


def _is_list(seen: Any) -> bool:
    return isinstance(seen, list | tuple)


def _shape(entry: Any) -> tuple[int, ...]:
    """Raises: TypeError for what is no array and no number."""
    if not (hasattr(entry, "shape") or isinstance(entry, int | float)):
        raise TypeError(
            "`observe` must return an array, or a mapping of column names to scalars, but there is "
            f"{kind_of(entry)}."
        )
    return np.shape(entry)
