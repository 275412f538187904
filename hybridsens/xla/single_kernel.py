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

    The arguments begin as what the loop carries and the results end as it: of two vectors, one real, one whole.
    """
    # Its trace is kept: one for the shapes, and for the loop.
    function = jax.jit(rewritten(function), inline=True)

    def looped(*arguments):
        given, result = pack(arguments), jax.eval_shape(lambda *given: pack(function(*given)), *arguments)
        if sum(leaf.size * leaf.dtype.itemsize for leaf in given.alone + result.alone) > _LONG:
            return pack(function(*arguments))
        reals, wholes = max(given.real.size, result.real.size), max(given.whole.size, result.whole.size)
        fit = lambda part, size: jnp.pad(part, (0, size - part.size))
        counted = lambda turn, whole: jnp.concatenate([turn[None], fit(whole, wholes)])

        def body(carry):
            real, whole, _ = carry
            # Tied to what changes, they are no constants of the loop, out of which XLA would move their arithmetic.
            whole, alone = lax.optimization_barrier((whole, given.alone))
            done = pack(function(*Packed(real, whole[1:], alone, given.layout).unpack()))
            return fit(done.real, reals), counted(whole[0] + 1, done.whole), done.alone

        zero = _zero(given.real)
        blank = [jnp.broadcast_to(zero.astype(leaf.dtype), leaf.shape) for leaf in result.alone]
        start = fit(given.real, reals), counted(zero.astype(given.whole.dtype), given.whole), blank
        real, whole, alone = lax.while_loop(lambda carry: carry[1][0] < 1, body, start)
        return Packed(real[: result.real.size], whole[1 : 1 + result.whole.size], alone, result.layout)

    return looped


def _zero(real):
    """A zero that XLA cannot foresee, and that waits for the arguments.

    Were it a constant, XLA would count the loop's turn and remove the loop; and the fewer kernels are ready at once,
    the less reason there is to wake a thread."""
    return jnp.signbit(jnp.abs(jnp.sum(lax.optimization_barrier(real)[:1])))
