"""Tangents of one function in several directions: what they share is computed once.

The Jacobian of a motion is one tangent pass under `jax.vmap`, with an element for each direction. Left alone, XLA puts
what the directions share (a cosine of the force, say) into the arithmetic of every one of them.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax

from ..xla.once import computed_once


def push(function: Callable[..., Any], here, primals, tangents):
    """`function(*primals)` and its tangent, as `jax.jvp`; None in the place of a tangent is zero.

    `here` is true wherever this is reached, and nothing that the compiler can foresee: the coefficients of the tangent
    map are what a conditional returns, so they are computed before, and not inside, the arithmetic of the directions.

    For forward mode alone: a branch that is not taken leaves zeros for coefficients, and the map may divide by them. A
    selection drops what comes of it going forward; transposed under `jax.vmap`, it would let nan through.
    """
    moving = jax.tree.map(lambda d, p: None if d is None else p, tangents, primals, is_leaf=_is_none)
    fixed = jax.tree.map(lambda d, p: p if d is None else None, tangents, primals, is_leaf=_is_none)
    of_moving = lambda moving: function(*eqx.combine(moving, fixed))
    value, tangent_map = computed_once(here, lambda: jax.linearize(of_moving, moving))
    return value, tangent_map(tangents)


def _is_none(leaf) -> bool:
    return leaf is None
