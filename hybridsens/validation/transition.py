"""What a transition of a system, or a switch of a scene, must return; and what it must not do to the mode."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Var

from .asked import Asked
from .returned import must_be_pair, must_match, outcome


def check_change(asked: Asked, parts: str, what: str, state: Any, given: tuple) -> None:
    """Raise ValueError or TypeError where a function of (event, *given), the last of which is the mode, does not return
    a pair like (state, mode). `parts` and `what` name these in a message."""
    arguments = jax.ShapeDtypeStruct((), jnp.asarray(0).dtype), *given
    after = outcome(asked, *arguments)
    must_be_pair(asked, after, parts)
    must_match(asked, what, after[0], state, exact=False)
    must_match(asked, "the mode", after[1], given[-1], exact=True)
    must_not_negate(asked, *arguments)


def must_not_negate(asked: Asked, *arguments: Any) -> None:
    """Raise TypeError where a function, whose last argument is the mode, applies `~` to a whole number in it: `~1` is
    -2, which counts as true.

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
