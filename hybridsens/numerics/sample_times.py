"""How many samples a program is compiled for."""

import jax.numpy as jnp
from jaxtyping import Array, Float

LEAST = 16


def with_room(times: Float[Array, "sample"]) -> Float[Array, "room"]:
    """The times, with the last of them again and again up to a number that is a power of two.

    Each number of samples is a program of its own, so those of few numbers are compiled for."""
    room = max(LEAST, 1 << (times.shape[0] - 1).bit_length())
    return jnp.pad(times, (0, room - times.shape[0]), mode="edge")
