"""How a state passes a jump time: it moves on while the clock does."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..flat_system import AbstractFlatSystem, Mode
from .record import after_jump, before_jump


def past_jump(
    system: AbstractFlatSystem, t: Float[Array, ""], x: Float[Array, "state"], modes: tuple[Mode, Mode]
) -> Float[Array, "state"]:
    """The state where the clock stands after jump time t, from that where it stood before, each part by its own flow.

    The clock takes a few units of its last place to pass. At late clocks these are long: a state that stood still
    meanwhile would lose six microseconds of its motion at each jump time, at t = 1.7e9."""
    begin, end = before_jump(t), after_jump(t)
    sides = jax.tree.map(lambda *side: jnp.stack(side), (begin, x, modes[0]), (end, x, modes[1]))
    flows = lax.map(lambda side: system.flow(*side), sides)  # one copy of the flow to compile
    return x + (t - begin) * flows[0] + (end - t) * flows[1]
