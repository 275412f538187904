"""Where a scene is not smooth: kinks and jumps that the traces of its functions show, and gaps at which a motion cannot
go on."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..discontinuities import listed_breaks, warn
from ..interval.break_rules import Break
from ..numerics.tolerances import MOST_RELAXED, closeness, time_resolution
from .contact import gap_and_rate
from .mass import mass_entries
from .mode import ContactMode
from .scene import AbstractScene
from .wrapped import as_written

WIDER = 16
"""Ratio of the two distances at which a gap is looked at."""


def has_jumped(guard, rate, tolerance, t) -> Bool[Array, ""]:
    """Whether a guard that should be 0 at an impact is far below: farther than the resolution of time explains."""
    return guard < -(tolerance + time_resolution(t, MOST_RELAXED) * jnp.abs(rate))


def is_not_smooth(scene: AbstractScene, t, q, v, mode: ContactMode) -> Bool[Array, ""]:
    """Whether a held gap, or its rate, jumps just ahead of (t, q, v), or the gap has jumped just now.

    The change over a short distance h, by more than the rate explains, is of the order of h where the gap is smooth
    (of h^2 for the gap itself), and as large at h / 16 as at h where it jumps. A jump at a declared time lies behind:
    it has left the gap off what it is held at.
    """
    near = jnp.finfo(q.dtype).eps ** 0.6 * jnp.abs(t)
    gap, rate = gap_and_rate(scene, t, q, v)

    def changes(h):
        ahead, rate_ahead = gap_and_rate(scene, t + h, q + h * v, v)
        return jnp.abs(ahead - gap - h * rate), jnp.abs(rate_ahead - rate)

    scales = mode.gap_tolerance(t), closeness(q.dtype) * mode.speed
    behind = jnp.abs(gap - mode.held_gap) > scales[0] + time_resolution(t, MOST_RELAXED) * jnp.abs(rate)
    jumps = [
        (close > far / 4) & (close > 4 * scale)
        for close, far, scale in zip(changes(near), changes(WIDER * near), scales, strict=True)
    ]
    return jnp.any(mode.active & (jumps[0] | jumps[1] | behind))


REMEDIES = {
    "time": "For a jump or a kink in time declare its instants by `jump_ts=`, or by a method `jump_times(self)` of the "
    "scene; a gap may have a kink there, but must not jump.",
    "gap": "For a minimum of gaps write one gap for each, and round off the corner of a maximum.",
    "state": "For a jump in q or v set `located_discontinuities = True` in the scene, which makes comparisons events "
    "(a cast to integers is not made one: write `jnp.floor`); or make it a contact, or a switch of an "
    "`AbstractSwitchedScene`, as where dry friction brings a body to rest.",
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
    warn(scene_breaks(scene, t, q, v, running_cost), times_declared, REMEDIES, "scene")


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
