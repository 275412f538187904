"""What of a motion a cost can depend on, in one record, whose tangents and cotangents are of its own type; and what
else is told of its events."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


class EventStates(NamedTuple):
    """Where events happen: one of them, or a row for each."""

    time: Float[Array, "*event"]
    before: Float[Array, "*event state"]
    """State just before, x-."""
    after: Float[Array, "*event state"]
    """State just after, x+."""
    emitted: Any
    """What the reset emitted: impulses in mechanics."""


class EventMarks(NamedTuple):
    """What is discrete about events: about one of them, or a row for each."""

    number: Int[Array, "*event"]
    """Which event; -1 in a row that is padding."""
    kind: Int[Array, "*event"]
    """What it is, as a number that the system gives a meaning; -1 in padding."""
    order_matters: Bool[Array, "*event"]
    mode: Any
    """The mode that it led to."""
    count: Int[Array, ""]
    """How many events there are; with one of them, how many there have been."""


class Observables(NamedTuple):
    """The real numbers that are reported of a motion. In a cotangent None stands for zero."""

    final: Float[Array, "state"]
    samples: Float[Array, "sample state"] | None
    """States at the times asked for."""
    events: EventStates
    out_of_steps: Float[Array, ""] | None
    """A mark, 0. Its tangent is 1 where forward mode ran out of steps (see `out_of_steps`)."""


def filled(primal: Any, tangent: Any) -> Any:
    """A tangent, or a cotangent, with zeros in the place of None."""
    fill = lambda d, p: jax.tree.map(jnp.zeros_like, p) if d is None else d
    return jax.tree.map(fill, tangent, primal, is_leaf=lambda leaf: leaf is None)
