"""The times of some of a motion's events, for costs that read them."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def first_times(
    time: Float[Array, "*batch event"], wanted: Bool[Array, "*batch event"], count: int
) -> Float[Array, "*batch first"]:
    """Times of the first `count` events that are wanted, along the last axis; inf where there are fewer of them.

    Raises: ValueError for a `count` that is none, or that is more than there is room for.
    """
    room = time.shape[-1]
    if not isinstance(count, int) or not 0 < count <= room:
        raise ValueError(f"`count` must be an integer from 1 to max_events = {room}, but is {count!r}.")
    rows = jnp.argsort(~wanted, axis=-1, stable=True)[..., :count]
    found = jnp.take_along_axis(wanted, rows, -1)
    return jnp.where(found, jnp.take_along_axis(time, rows, -1), jnp.inf)
