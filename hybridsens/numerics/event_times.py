"""What costs and studies read of all events of a motion: the times of some of them, and their order."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


def first_times(
    time: Float[Array, "..."], wanted: Bool[Array, "..."], count: int
) -> Float[Array, "*batch first"]:
    """Times of the first `count` events that are wanted, along the last axis; inf where there are fewer of them.

    Raises: ValueError for a `count` that is none, or that is more than there is room for; for one event.
    """
    _must_be_all(time)
    room = time.shape[-1]
    if not isinstance(count, int) or not 0 < count <= room:
        raise ValueError(f"`count` must be an integer from 1 to max_events = {room}, but is {count!r}.")
    rows = jnp.argsort(~wanted, axis=-1, stable=True)[..., :count]
    found = jnp.take_along_axis(wanted, rows, -1)
    return jnp.where(found, jnp.take_along_axis(time, rows, -1), jnp.inf)


def sequence_number(code: Int[Array, "..."], count: Int[Array, "*batch"]) -> Int[Array, "*batch"]:
    """A number that two motions share if their first `count` events have the same codes (else only by a rare accident).

    A polynomial modulo 2^32 with one digit, made of the code, for each event.

    Raises: ValueError for one event.
    """
    _must_be_all(code)
    happened = jnp.arange(code.shape[-1]) < count[..., None]
    powers = jnp.cumprod(jnp.full(code.shape[-1:], 2654435761, jnp.uint32))
    terms = jnp.where(happened, powers * (1 + code).astype(jnp.uint32), 0)
    return jnp.sum(terms, axis=-1, dtype=jnp.uint32).astype(jnp.int32)


def _must_be_all(column: Array) -> None:
    """Raises: ValueError for one event, as `until` is given: it knows none of those before it."""
    if column.ndim == 0:
        raise ValueError("This is asked of all events of a motion, not of one event: read its `time` and `count`.")
