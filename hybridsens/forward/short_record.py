"""A record cut to its first rows: all of it where a motion is short, and small enough for every element of a batch."""

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

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
        if not rows.ndim:
            return rows
        more = jnp.broadcast_to(rows[-1:], (shape.shape[0] - rows.shape[0], *rows.shape[1:]))
        return jnp.concatenate([rows, more])

    return jax.tree.map(grown, short, full)
