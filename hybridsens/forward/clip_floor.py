"""The time from which on Diffrax rounds a step's end to the end of the solve, in a fifth of its operations.

Diffrax takes `t1` less a hundred units in the last place, by a hundred calls of `prevbefore` at the start of every
solve. Each is twenty operations on bits: together a quarter of what there is to compile in a short motion's gradient.
The same number is found by plain arithmetic, four operations a call.
"""

import contextlib
import types

import equinox.internal as theirs
import jax.numpy as jnp
from diffrax import _integrate
from jaxtyping import Array, Float


def prevbefore(t: Float[Array, "..."]) -> Float[Array, "..."]:
    """The number before t. Six tenths of eps |t| are between a half and a whole unit in its last place on either side
    of a power of two, so that what is left rounds to the next number down."""
    spacing = 0.6 * float(jnp.finfo(t.dtype).eps) * jnp.abs(t)
    return t - jnp.maximum(spacing, jnp.finfo(t.dtype).tiny)


_OURS = types.SimpleNamespace(**{**vars(theirs), "prevbefore": prevbefore})


@contextlib.contextmanager
def short_clip_floor():
    """While Diffrax traces a solve of ours, its `prevbefore` is the one above; other solves keep theirs."""
    _integrate.eqxi = _OURS  # pyright: ignore[reportPrivateImportUsage]
    try:
        yield
    finally:
        _integrate.eqxi = theirs  # pyright: ignore[reportPrivateImportUsage]
