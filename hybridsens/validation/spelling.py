"""Suggests the known name nearest to a misspelt one."""

import difflib
import inspect
from collections.abc import Iterable

from .caller import warn_caller


def did_you_mean(names: str | Iterable[str], known: Iterable[str]) -> str:
    """" Did you mean 'weight'?" for "wieght", to end a message with; empty if no known name is near."""
    names, known = [names] if isinstance(names, str) else list(names), list(known)
    lower = {name.lower(): name for name in reversed(known)}  # "Up" for "up" is near too
    near = [lower[match] for name in names for match in difflib.get_close_matches(name.lower(), lower, n=1)]
    return f" Did you mean {', '.join(map(repr, dict.fromkeys(near)))}?" if near else ""


ASKED_BY_STUDIES = {"initial_state", "initial_mode", "running_cost", "coordinates", "contacts", "event_names"}
"""What a scene or a system may have and no class asks for."""


def warn_of_near_names(cls: type) -> None:
    """Say where a class defines a name that is nearly one which this package asks for and which another class has
    defined, `applied_forces` for `applied_force`: nothing would read it, and that other one is used in silence."""
    package = __name__.partition(".")[0] + "."
    ours = [base for base in cls.__mro__[1:] if inspect.isabstract(base) and base.__module__.startswith(package)]
    known = {name for base in ours for name in vars(base) if not name.startswith("_")} | ASKED_BY_STUDIES
    inherited = [name for name in known - vars(cls).keys() if hasattr(cls, name)]
    missing = getattr(cls, "__abstractmethods__", frozenset())  # without these nothing is made of the class
    defaults = [name for name in inherited if name not in missing]
    for name in vars(cls).keys() - known:
        alike = [of_base for of_base in defaults if callable(getattr(cls, of_base)) == callable(getattr(cls, name))]
        near = difflib.get_close_matches(name, alike, n=1, cutoff=0.85)
        if near:
            warn_caller(
                f"{cls.__name__} defines `{name}`, which nothing reads. Is `{near[0]}` meant? If not, choose a name "
                "that is less near to it."
            )
