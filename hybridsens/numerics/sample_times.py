"""Times at which a motion is asked for afterwards: which there may be, and how many a program is compiled for."""

from collections.abc import Callable
from typing import Any

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

LEAST = 16


def at_times(ts, dtype, horizon: tuple, sampled: Callable[[Float[Array, "sample"]], Any]) -> Any:
    """What a motion is at times between (t0, t1), a number or an array in any order: a PyTree of arrays (*ts, ...).

    `sampled` gives (sample, ...) for times in their order. It is asked with some more of them than there are: each
    number of samples is a program of its own.

    Raises: ValueError as `must_lie_within`."""
    times = jnp.asarray(ts, float)
    must_lie_within(times.astype(dtype), *horizon)
    order = jnp.argsort(times, axis=None)
    found = sampled(_with_room(times.ravel()[order].astype(dtype)))
    places = jnp.argsort(order).reshape(times.shape)
    return jax.tree.map(lambda leaf: leaf[places], found)


def must_lie_within(times, t0, t1) -> None:
    """Raise ValueError for a time outside of [t0, t1], in the type of the times, and for one that is no number; nothing
    of traced ones."""
    if any(isinstance(given, jax.core.Tracer) for given in (times, t0, t1)):
        return
    times = np.ravel(times)
    t0, t1 = (np.asarray(end, times.dtype) for end in (t0, t1))
    outside = ~((times >= t0) & (times <= t1))
    if outside.any():
        first = times[outside.argmax()]
        ends = f"[{_shown(t0)}, {_shown(t1)}]"
        raise ValueError(f"Times must lie within [t0, t1] = {ends}, but {_shown(first)} does not.")


def time_in_the_way(ts, t0, t1) -> str:
    """A sentence about the first of the times that lies outside of [t0, t1], or before the one before it.

    All digits are shown: the last of `np.arange` is beyond t1 by the last of them alone."""
    ts, t0, t1 = np.asarray(ts), np.asarray(t0), np.asarray(t1)
    outside = ~((ts >= t0) & (ts <= t1))
    first = int(np.argmax(outside | (np.diff(ts, prepend=ts[0]) < 0)))
    shown = f"Here ts[{first}] is {_shown(ts[first])}, t0 is {_shown(t0)} and t1 is {_shown(t1)}."
    if not outside[first]:
        return shown
    by_rounding = np.maximum(t0 - ts, ts - t1)[outside] <= 1e-12 * np.maximum(abs(t0), abs(t1))
    if by_rounding.all():
        return f"{shown} Rounding put it there: give `jnp.clip(ts, t0, t1)`."
    return f"{shown} Of {ts.size} times {np.sum(outside)} lie outside."


def _shown(time) -> str:
    """All digits that tell a time from its neighbours."""
    return str(time).removesuffix(".0")


def _with_room(times: Float[Array, "sample"]) -> Float[Array, "room"]:
    """The times, with the last of them again and again up to a number that is a power of two."""
    if not times.shape[0]:
        return times
    room = max(LEAST, 1 << (times.shape[0] - 1).bit_length())
    return jnp.pad(times, (0, room - times.shape[0]), mode="edge")
