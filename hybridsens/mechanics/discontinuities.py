"""A warning where a scene's functions have kinks or jumps that no event tells of."""

import warnings
from collections.abc import Callable

import jax

from ..interval.breaks import Break, breaks
from .mass import mass_entries
from .scene import AbstractScene
from .typed import as_written


class DiscontinuityWarning(UserWarning):
    """A function of the scene has a kink or a jump in time or in the state that is no event."""


REMEDIES = {
    "time": "For a jump in time declare its instants by `jump_ts=`, or by a method `jump_times(self)` of the scene.",
    "gap": "For a minimum of gaps write one gap for each, and round off the corner of a maximum.",
    "state": "For a jump in q or v make it an event: a contact, or a switch of an `AbstractSwitchedScene`.",
}
SILENCE = (
    "If it does no harm, set `known_discontinuities = True` in the scene, or ignore `hybridsens.DiscontinuityWarning` "
    "by `warnings.filterwarnings`."
)


def warn_of_discontinuities(
    scene: AbstractScene, t, q, v, running_cost: Callable | None = None, times_declared: bool = False
) -> None:
    """Say once what the traces of the scene's functions show: kinks and jumps in t, q or v.

    What depends on parameters alone is none, nor is what depends on t alone where its times are declared. Of a running
    cost only jumps count: its kinks leave the gradient right. A guard such as `jnp.where(r > 0, r, 1)` looks like a
    jump and is told as one.
    """
    if scene.known_discontinuities:
        return
    found = scene_breaks(scene, t, q, v, running_cost)
    if times_declared:
        found = {name: [b for b in those if b.inputs != {"t"}] for name, those in found.items()}
    found = {name: those for name, those in found.items() if those}
    if found:
        warnings.warn(_message(found), DiscontinuityWarning, stacklevel=2)


def scene_breaks(scene: AbstractScene, t, q, v, running_cost: Callable | None = None) -> dict[str, list[Break]]:
    """Kinks and jumps of each function of the scene, by its name."""
    functions = {
        "force": (scene.force, ("t", "q", "v"), (t, q, v)),
        "gap": (scene.gap, ("t", "q"), (t, q)),
        "mass_matrix": (lambda q: mass_entries(scene.mass_matrix(q)), ("q",), (q,)),
    }
    found = {name: _breaks(f, inputs, given) for name, (f, inputs, given) in functions.items()}
    if running_cost is not None:
        of_cost = _breaks(lambda t, q, v: running_cost(as_written(scene), t, q, v), ("t", "q", "v"), (t, q, v))
        found["running_cost"] = [b for b in of_cost if b.jump]
    return found


def _breaks(function: Callable, inputs, given) -> list[Break]:
    return sorted(breaks(jax.make_jaxpr(function)(*given), inputs), key=lambda b: (b.operation, sorted(b.inputs)))


def _message(found: dict[str, list[Break]]) -> str:
    """One sentence for each function, then what follows and what to do."""
    told = " ".join(f"`{name}` must be smooth, but has {_listed(those)}." for name, those in found.items())
    inputs = {name: frozenset().union(*(b.inputs for b in those)) for name, those in found.items()}
    needed = {
        "time": any("t" in these for these in inputs.values()),
        "gap": "gap" in found,
        "state": any(these - {"t"} for name, these in inputs.items() if name != "gap"),
    }
    remedies = " ".join(text for name, text in REMEDIES.items() if needed[name])
    return (
        f"{told} A kink costs accuracy; a jump makes the gradient wrong, because the shift of its instant is left out. "
        f"{remedies} {SILENCE}"
    )


def _listed(those: list[Break]) -> str:
    inputs_of = {b.operation: set() for b in those}
    for b in those:
        inputs_of[b.operation] |= b.inputs
    named = lambda inputs: " and ".join(name for name in "tqv" if name in inputs)
    return ", ".join(f"{operation} of {named(inputs)}" for operation, inputs in inputs_of.items())
