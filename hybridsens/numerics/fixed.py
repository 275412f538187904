"""Numbers that ride along in a PyTree of parameters, and are none."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np


class Fixed(eqx.Module):
    """A number that a motion depends on and is not differentiated by.

    Every real array of a system is a parameter, and costs the way back a derivative; the bits of one are not real."""

    bits: jax.Array | np.ndarray
    dtype: Any = eqx.field(static=True)

    @staticmethod
    def of(value, dtype) -> "Fixed":
        """The number in that type."""
        dtype = jnp.dtype(dtype)
        bits = jnp.dtype(f"int{8 * dtype.itemsize}")
        if isinstance(value, jax.Array):
            return Fixed(jax.lax.bitcast_convert_type(value.astype(dtype), bits), dtype)
        return Fixed(np.asarray(value, dtype).view(bits), dtype)

    @staticmethod
    def unless_constant(value, dtype) -> "float | Fixed":
        """A number as it is, where a program is compiled for it alone; another one in that type."""
        return value if isinstance(value, float) else Fixed.of(value, dtype)

    @property
    def number(self) -> jax.Array:
        """The number itself."""
        return jax.lax.bitcast_convert_type(self.bits, self.dtype)


def number(value):
    """What stands for a number, as that number."""
    return value.number if isinstance(value, Fixed) else value
