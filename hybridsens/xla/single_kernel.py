"""A function that runs as one compiled kernel of a CPU.

XLA runs a program there as a list of small kernels, and as soon as there are more than a few of them, on several
threads. To wake a thread takes longer than a short motion. A loop is compiled into one kernel (see `configure`), so a
loop of one turn makes one of all that is inside of it; and as every array that it carries begins as a kernel of its
own, it carries few.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from .packed import Packed, pack
from .rewriting import rewritten

_LONG = 1_000_000
"""Bytes of large arrays from which on a function stays as it is: the loop would hold them twice, and what goes on for
so long does not mind a few kernels more."""


def in_one_kernel(function: Callable[..., Any]) -> Callable[..., Packed]:
    """`function` of PyTrees of arrays, with its result packed.

    The loop begins with the arguments in what it carries and ends with the result there: two vectors, of floating
    numbers and of integers, each long enough for both, and the `separate` leaves of the result. Those of the arguments
    are read from outside.
    """
    # One trace serves the shapes and the loop.
    function = jax.jit(rewritten(function), inline=True)

    def looped(*arguments):
        given, result = pack(arguments), jax.eval_shape(lambda *given: pack(function(*given)), *arguments)
        if sum(leaf.size * leaf.dtype.itemsize for leaf in given.separate + result.separate) > _LONG:
            return pack(function(*arguments))
        floating_size = max(given.floating.size, result.floating.size)
        integer_size = max(given.integer.size, result.integer.size)
        fit = lambda part, size: jnp.pad(part, (0, size - part.size))
        counted = lambda turn, integer: jnp.concatenate([turn[None], fit(integer, integer_size)])

        def body(carry):
            floating, integer, _ = carry
            # Tied to what changes, they are no constants of the loop, out of which XLA would move their arithmetic.
            integer, separate = lax.optimization_barrier((integer, given.separate))
            done = pack(function(*Packed(floating, integer[1:], separate, given.layout).unpack()))
            return fit(done.floating, floating_size), counted(integer[0] + 1, done.integer), done.separate

        zero = _zero(given.floating)
        blank = [jnp.broadcast_to(zero.astype(leaf.dtype), leaf.shape) for leaf in result.separate]
        start = fit(given.floating, floating_size), counted(zero.astype(given.integer.dtype), given.integer), blank
        floating, integer, separate = lax.while_loop(lambda carry: carry[1][0] < 1, body, start)
        return Packed(floating[: result.floating.size], integer[1 : 1 + result.integer.size], separate, result.layout)

    return looped


def _zero(floating):
    """A zero that XLA cannot foresee, and that waits for the arguments.

    Were it a constant, XLA would count the loop's turn and remove the loop; and the fewer kernels are ready at once,
    the less reason there is to wake a thread."""
    return jnp.signbit(jnp.abs(jnp.sum(lax.optimization_barrier(floating)[:1])))
