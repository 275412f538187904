"""A warning where functions of a scene or a system have kinks or jumps that no event tells of."""

from collections.abc import Callable, Iterable, Mapping

import jax
import jax.numpy as jnp

from .interval.break_rules import Break
from .interval.breaks import breaks
from .system import AbstractHybridSystem
from .validation.caller import warn_caller


class DiscontinuityWarning(UserWarning):
    """A function of the scene or system has a kink or a jump in time or in the state that is no event."""


REMEDIES = {
    "time": "For a jump or a kink in time declare its instants by `jump_ts=`, or by a method `jump_times(self)` of the "
    "system.",
    "guards": "For the first of several guards write one guard for each, and for a comparison in a guard what is "
    "compared, `place - x`; or set `located_discontinuities = True` in the system.",
    "state": "For a jump in x set `located_discontinuities = True` in the system, which makes comparisons events (a "
    "cast to integers is not made one: write `jnp.floor`); or write a guard that falls there, and a mode that its "
    "transition changes.",
}


def warn_of_system(system: AbstractHybridSystem, cost_rate: Callable | None, given, times_declared: bool) -> None:
    """Say once what the traces of a system's functions show: kinks and jumps in t or x.

    `cost_rate` and the functions are called by `given`, (t, x, mode). What depends on parameters and the mode alone is
    no break, nor is what depends on t alone where its times are declared. Of a running cost only jumps count. A
    transition may choose as it likes."""
    if system.known_discontinuities:
        return
    warn(system_breaks(system, cost_rate, given), times_declared, REMEDIES, "system")


def system_breaks(system: AbstractHybridSystem, cost_rate: Callable | None, given) -> dict[str, list[Break]]:
    """Kinks and jumps of each function of a system, by its name; of a running cost jumps alone."""
    of = lambda function: listed_breaks(function, ("t", "x", None), given)
    found = {"flow": of(system.flow), "guards": of(system.guards)}
    if cost_rate is not None:
        found["running_cost"] = [b for b in of(cost_rate) if b.jump]
    return found


def remedies_for(moved: Mapping[str, Iterable[str]], remedies: Mapping[str, str]) -> list[str]:
    """Those that serve, given what moves the breaks of each function: the remedy for "time", that for the "state", and
    those of a function by its name."""
    of_others = [set(inputs) - {"t"} for name, inputs in moved.items() if name not in remedies]
    needed = {"time": any("t" in inputs for inputs in moved.values()), "state": any(of_others)}
    return [text for name, text in remedies.items() if needed.get(name, name in moved)]


def listed_breaks(function: Callable, names, given) -> list[Break]:
    """Kinks and jumps of a function in its arguments, which may be PyTrees; None names one that does not move."""
    inputs = [name for name, argument in zip(names, given, strict=True) for _ in jax.tree.leaves(argument)]
    found = breaks(jax.make_jaxpr(function)(*jax.tree.map(jnp.asarray, given)), inputs)
    return sorted(found, key=lambda b: (b.operation, sorted(b.inputs)))


def that_matter(found: Mapping[str, list[Break]], times_declared: bool) -> dict[str, list[Break]]:
    """Functions that have any, without those in t alone where their times are declared."""
    if times_declared:
        found = {name: [b for b in those if b.inputs != {"t"}] for name, those in found.items()}
    return {name: those for name, those in found.items() if those}


def warn(found: Mapping[str, list[Break]], times_declared: bool, remedies: Mapping[str, str], owner: str) -> None:
    """One sentence for each function that has breaks that matter, then what follows and what to do; nothing where none
    has."""
    found = that_matter(found, times_declared)
    if not found:
        return
    moved = {name: frozenset().union(*(b.inputs for b in those)) for name, those in found.items()}
    remedy = " ".join(remedies_for(moved, remedies))
    told = " ".join(f"`{name}` must be smooth, but has {_listed(those)}." for name, those in found.items())
    warn_caller(
        f"{told} A kink costs accuracy; a jump makes the gradient wrong, because the shift of its instant is left out. "
        f"{remedy} If it does no harm, set `known_discontinuities = True` in the {owner}, or ignore "
        "`hybridsens.DiscontinuityWarning` by `warnings.filterwarnings`.",
        DiscontinuityWarning
    )


def _listed(those: list[Break]) -> str:
    inputs_of = {b.operation: set() for b in those}
    for b in those:
        inputs_of[b.operation] |= b.inputs
    named = lambda inputs: " and ".join(name for name in "tqvx" if name in inputs)
    return ", ".join(f"{operation} of {named(inputs)}" for operation, inputs in inputs_of.items())
