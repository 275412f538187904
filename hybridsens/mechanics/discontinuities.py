"""What is said where a scene's functions have kinks or jumps that no event tells of."""

from collections.abc import Callable

from ..discontinuities import listed_breaks, remedies_for, that_matter, warn
from ..interval.breaks import Break
from .mass import mass_entries
from .scene import AbstractScene
from .typed import as_written

REMEDIES = {
    "time": "For a jump in time declare its instants by `jump_ts=`, or by a method `jump_times(self)` of the scene.",
    "gap": "For a minimum of gaps write one gap for each, and round off the corner of a maximum.",
    "state": "For a jump in q or v make it an event: a contact, or a switch of an `AbstractSwitchedScene`.",
}


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
    found = that_matter(scene_breaks(scene, t, q, v, running_cost), times_declared)
    inputs = {name: frozenset().union(*(b.inputs for b in those)) for name, those in found.items()}
    warn(found, remedies_for(inputs, REMEDIES), "scene")


def scene_breaks(scene: AbstractScene, t, q, v, running_cost: Callable | None = None) -> dict[str, list[Break]]:
    """Kinks and jumps of each function of the scene, by its name."""
    functions = {
        "force": (scene.force, ("t", "q", "v"), (t, q, v)),
        "gap": (scene.gap, ("t", "q"), (t, q)),
        "mass_matrix": (lambda q: mass_entries(scene.mass_matrix(q)), ("q",), (q,)),
    }
    found = {name: listed_breaks(*given) for name, given in functions.items()}
    if running_cost is not None:
        of_cost = listed_breaks(lambda t, q, v: running_cost(as_written(scene), t, q, v), ("t", "q", "v"), (t, q, v))
        found["running_cost"] = [b for b in of_cost if b.jump]
    return found
