"""A derivative that ran out of steps is raised, not returned as nan.

A motion and its way back are compiled without anything that may raise: a program that does is kept in no cache. So
the news leaves by the way that derivatives have. Beside all that a motion is made from goes a mark, a number 0, whose
cotangent the way back makes 1 where it did not come to an end; beside all that comes out goes another, whose tangent
forward mode makes 1. Both are looked at outside of the compiled motion, where the derivative passes as well.
"""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp

from .outcome import raised_unless_zero
from .xla.linear_map import LinearMap, tangent_types

ROOM = (
    "The derivative of the motion is not finished: its own error asks for more steps than there is room for. Raise "
    "`max_steps`, use a solver of a higher order, or allow a larger error, as by `adjoint=Replay(rtol=...)`, math.inf "
    "for any. Steps without end are asked for by a parameter that is small and cancels out of the motion, as a mass of "
    "1e-6 under gravity alone: count it in smaller units. With `throw=False` the derivative is nan."
)
RERUN = (
    "The derivative of the motion is not finished: the steps that Replay(recompute=True) ran again on the way back "
    "came out different, or more were needed than there is room for. Use Replay(), or raise `max_steps`. With "
    "`throw=False` the derivative is nan."
)


def marked(given: Any, mark: Any, reason: str) -> tuple[Any, Any]:
    """What a motion is made from, and a mark of 0. Where the cotangent of the mark is not 0, the derivative by what
    is given is raised for that reason."""
    leaves, rest = eqx.partition(given, _may_vary)
    if not jax.tree.leaves(leaves):
        return given, mark
    leaves, mark = _marked(leaves, mark, reason)
    return eqx.combine(leaves, rest), mark


def raised_if_marked(found: Any, mark: Any, reason: str) -> Any:
    """All that came out of a motion, beside its mark. Where the tangent of the mark is not 0, that of what is found is
    raised for that reason."""
    leaves, rest = eqx.partition(found, _may_vary)
    return eqx.combine(_unmarked(leaves, mark, reason), rest) if _may_vary(mark) else found


def _may_vary(x: Any) -> bool:
    """Only what is traced carries a derivative, and outside of a trace every operation costs a call."""
    return isinstance(x, jax.core.Tracer) and eqx.is_inexact_array(x)


@eqx.filter_custom_jvp
def _marked(given, mark, reason):
    del reason
    return given, jnp.asarray(mark)


@_marked.def_jvp
def _marked_jvp(primals, tangents):
    given, mark, reason = primals
    leaves, structure = jax.tree.flatten(tangents[0])
    add = lambda _, d: [*d, jnp.zeros_like(mark)]
    take = lambda _, cotangents: _raised(cotangents, reason)
    *leaves, d_mark = LinearMap(add, take)([], leaves, tangent_types((leaves, mark)))
    return _marked(given, mark, reason), (structure.unflatten(leaves), d_mark)


@eqx.filter_custom_jvp
def _unmarked(found, mark, reason):
    del mark, reason
    return found


@_unmarked.def_jvp
def _unmarked_jvp(primals, tangents):
    (found, mark, reason), (d_found, d_mark, _) = primals, tangents
    found = _unmarked(found, mark, reason)  # where this is differentiated again
    if d_mark is None:
        return found, d_found
    leaves, structure = jax.tree.flatten(d_found)
    take = lambda _, d: _raised(d, reason)
    add = lambda _, cotangents: [*cotangents, None]
    leaves = LinearMap(take, add)([], [*leaves, d_mark], tangent_types(leaves))
    return found, structure.unflatten(leaves)


def _raised(marked_leaves: list, reason: str) -> list:
    """All but the mark, which is last. None stands for 0. A second derivative alone is told of by its tangent."""
    *leaves, mark = marked_leaves
    if mark is None:
        return leaves
    leaves = raised_unless_zero(leaves, (mark != 0).astype(int), lambda _: reason)
    return raised_if_marked(leaves, mark, reason)
