"""A flag of the mode that is given as a whole number: `~1` is -2, which counts as true."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Var

from .asked import Asked


def must_not_negate(asked: Asked, *arguments: Any) -> None:
    """Raise TypeError where a function, whose last argument is the mode, applies `~` to a whole number in it.

    Where `&` takes single bits of what comes out (`~mode & 1`), nothing is wrong."""
    leaves = jax.tree.leaves(arguments[-1])
    if not any(map(_is_whole, leaves)):
        return
    jaxpr = eqx.filter_make_jaxpr(asked.function)(*arguments)[0].jaxpr
    whole = {x for x, leaf in zip(jaxpr.invars[-len(leaves) :], leaves, strict=True) if _is_whole(leaf)}
    operands = lambda name: [(e.invars, e.outvars[0]) for e in jaxpr.eqns if e.primitive.name == name]
    of_bits = {x for both, _ in operands("and") for x in both if isinstance(x, Var)}
    if any(isinstance(x, Var) and x in whole and result not in of_bits for (x,), result in operands("not")):
        raise TypeError(
            f"`{asked.name}` must not apply `~` to a whole number of the mode, but {asked.it}does: of 1 it is -2, "
            "which counts as true. Begin in a mode of True or False; or write `1 - mode`, and for bits `mode ^ mask`."
        )


def _is_whole(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jnp.integer)
