"""Names of coordinates and their velocities, for tables and axes."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

_WITH_UNIT = re.compile(r"(.+?)\s+\[(.*)\]")


class Names(NamedTuple):
    """The names that a scene gives, where the scene itself is not known; None for what it does not name."""

    coordinates: tuple[str, ...] | None
    contacts: tuple[str, ...] | None


def coordinate_names(scene: Any, dof: int) -> tuple[list[str], list[str]]:
    """Names of q and of v, with units where the scene tells them by `coordinates`.

    "angle [rad]" has the velocity "angle rate [rad/s]"; without names they are q[0], ... and v[0], ...
    Raises: ValueError if the scene names another number of coordinates than it has, or two columns alike."""
    given = _given(scene, "coordinates", dof, f"entry of q (the state has {dof})")
    if given is None:
        return [f"q[{i}]" for i in range(dof)], [f"v[{i}]" for i in range(dof)]
    rates = [_rate(name) for name in given]
    must_differ([*given, *rates], f"Coordinates of {type(scene).__name__} and their rates", "`coordinates`")
    return given, rates


def must_differ(names: Sequence[str], what: str, where: str) -> None:
    """Raise ValueError where two columns would have one name: a table could keep one of them only."""
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise ValueError(
            f"{what} must have different names, but {', '.join(map(repr, twice))} is that of more than one: rename it "
            f"in {where}."
        )


def _rate(name: str) -> str:
    """The name of a velocity from that of its coordinate."""
    what, unit = split_unit(name)
    if unit is None:
        return f"{name} rate"
    if unit.endswith(" s"):  # of a flux linkage [V s] it is a voltage
        return f"{what} rate [{unit.removesuffix(' s')}]"
    return f"{what} rate [{'1/s' if unit in ('', '1') else f'{unit}/s'}]"


def split_unit(name: str) -> tuple[str, str | None]:
    """("height", "m") of "height [m]"; ("q[0]", None) of what has no unit behind a space."""
    found = _WITH_UNIT.fullmatch(name)
    return (name, None) if found is None else (found[1], found[2])


def unit_of_contact(scene: Any, unit: str) -> str:
    """What stands behind the name of a contact's number: " [m/s]", or "" where the scene's `coordinates` tell that it
    counts in other units, so that those of its gaps are not known, or its `contacts` that a gap is no length."""
    units = {
        what: {unit for _, unit in map(split_unit, map(str, getattr(scene, what, None) or ())) if unit is not None}
        for what in ("coordinates", "contacts")
    }
    return f" [{unit}]" if units["coordinates"] <= {"m", "rad", "1", ""} and units["contacts"] <= {"m"} else ""


def names_of(dataset: Any) -> Names:
    """The names in a dataset of a motion; those that stand for no name are none."""
    coordinates, contacts = ([str(name) for name in dataset[axis].values] for axis in ("coordinate", "contact"))
    named = coordinates != coordinate_names(None, len(coordinates))[0]
    return Names(tuple(coordinates) if named else None, tuple(contacts))


def event_names(system: Any, guards: int, scheduled: int, comparisons: int) -> tuple[str, ...] | None:
    """Names of the events of a system: those of its guards and its scheduled times, then those of its comparisons. None
    where all are numbers. Where guards alone are named, scheduled times are "time 0" and so on.

    Raises: ValueError if the system names another number of events than it has."""
    given, count = getattr(system, "event_names", None), guards + scheduled
    if isinstance(given, tuple) and 0 < len(given) == guards < count:
        own = [*(_given(system, "event_names", guards, "guard") or ()), *(f"time {k}" for k in range(scheduled))]
    else:
        own = _given(system, "event_names", count, "guard and then each scheduled time, or one for each guard alone")
    if own is None and comparisons == 0:
        return None
    own = map(str, range(count)) if own is None else own
    return *own, *(f"comparison {k}" for k in range(comparisons))


def _given(scene: Any, what: str, count: int, each: str) -> list[str] | None:
    """The names that a scene gives; None without any. Raises: ValueError where they are not one for each."""
    given = getattr(scene, what, None)
    if given is None:
        return None
    if isinstance(given, str) or not all(isinstance(name, str) for name in given) or len(given) != count:
        raise ValueError(
            f"`{what}` of {type(scene).__name__} must be a tuple of {count} name{'' if count == 1 else 's'}, one for "
            f"each {each}, but is {given!r}."
        )
    return list(given)


def names_of_events(scene: Any, numbers: Iterable[Any], switched: Iterable[Any], contacts: int) -> list[str]:
    """What each event of a scene is of: the name of its contact, or of its switch where `switched`; else its number."""
    of_contacts, of_switches = contact_names(scene, contacts), getattr(scene, "event_names", None) or ()
    named = lambda i, names: names[i] if i < len(names) else str(i)
    return [
        named(int(i), of_switches if switch else of_contacts) for i, switch in zip(numbers, switched, strict=True)
    ]


def check_switch_names(scene: Any, count: int) -> None:
    """Raise ValueError if the scene's `event_names` are not one for each of its switches."""
    _given(scene, "event_names", count, "switch")


def contact_names(scene: Any, count: int) -> list[str]:
    """Names of the contacts: those of the scene's `contacts`, or their numbers.

    Raises: ValueError if the scene names another number of contacts than it has."""
    given = _given(scene, "contacts", count, "gap")
    return [str(i) for i in range(count)] if given is None else given
