"""A record cut to its first rows: all of it where a motion is short, and small enough for every element of a batch."""

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ..xla.once import unforeseen_zero
from .record import Motion

_STEPS = 512
_EVENTS = 128
"""Rows that are kept. The more, the more is copied for every motion; the fewer, the more motions are run again."""


def shortened(motion: Motion) -> Motion:
    """The same motion, with the first rows of its records."""
    cut = lambda record, room: jax.tree.map(lambda leaf: leaf[:room] if leaf.ndim else leaf, record)
    return dataclasses.replace(motion, steps=cut(motion.steps, _STEPS), events=cut(motion.events, _EVENTS))


def is_whole(short: Motion, full: Motion) -> Bool[Array, ""]:
    """Whether nothing was cut off that counts; `full` is a motion of the same room, or its shapes. False of zeros.

    The last row is blank then, as are those that were cut off: behind the ones that count, one more was written.
    """
    steps, events = short.steps.t.shape[0], short.events.steps.shape[0]
    all_steps = (steps == full.steps.t.shape[0]) | (short.steps.count + 2 < steps)
    all_events = (events == full.events.steps.shape[0]) | (short.events.count + 1 < events)
    return short.begun & all_steps & all_events


def lengthened(short: Motion, full: Motion) -> Motion:
    """A motion that is whole, with the room of `full`."""

    def grown(rows, shape):
        if rows.shape == shape.shape:
            return rows
        # The last row is blank, one number throughout. To ask of every row whether it is one of them would take longer.
        blank = jnp.full(shape.shape, rows.ravel()[-1] if rows.size else 0, rows.dtype)
        return lax.dynamic_update_slice(blank, rows, [unforeseen_zero()] * rows.ndim)

    return jax.tree.map(grown, short, full)
