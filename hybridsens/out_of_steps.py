"""A derivative that ran out of steps is raised, not returned as nan.

A motion and its way back are compiled without anything that may raise: a program that does is kept in no cache. So
the news leaves by the way that derivatives have. Beside all that a motion is made from goes a mark, a number 0, whose
cotangent the way back makes 1 where it did not come to an end; beside all that comes out goes another, whose tangent
forward mode makes 1. Both are looked at outside of the compiled motion, where the derivative passes as well.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from .outcome import raised_unless_zero

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


def marked(given: Any, dtype: Any, reason: str) -> tuple[Any, Any]:
    """What a motion is made from, and a mark of 0. Where the cotangent of the mark is not 0, the derivative by what is
    given is raised for that reason."""
    leaves, put_back = _that_may_vary(given)
    if not leaves:
        return given, np.zeros((), dtype)
    *leaves, mark = _mark.bind(*leaves, dtype=np.dtype(dtype), reason=reason)
    return put_back(leaves), mark


def raised_if_marked(found: Any, mark: Any, reason: str) -> Any:
    """All that came out of a motion, beside its mark. Where the tangent of the mark is not 0, that of what is found is
    raised for that reason."""
    if not isinstance(mark, jax.core.Tracer):
        return found
    leaves, put_back = _that_may_vary(found)
    return put_back(_unmark.bind(*leaves, mark, dtype=np.dtype(mark.dtype), reason=reason))


def _that_may_vary(tree: Any) -> tuple[list, Callable[[list], Any]]:
    """Leaves that may carry a derivative, which only what is traced does; and the tree of others in their places.

    Outside of a trace every operation costs a call."""
    leaves, structure = jax.tree.flatten(tree)
    varies = [isinstance(x, jax.core.Tracer) and eqx.is_inexact_array(x) for x in leaves]

    def put_back(others: list) -> Any:
        other = iter(others)
        return structure.unflatten([next(other) if flag else x for x, flag in zip(leaves, varies, strict=True)])

    return [x for x, flag in zip(leaves, varies, strict=True) if flag], put_back


def _add_mark(*leaves, dtype, reason) -> list:
    del reason
    return [*leaves, jnp.zeros((), dtype)]


def _add_type(*types, dtype, reason) -> list:
    del reason
    return [*types, jax.core.ShapedArray((), dtype)]


def _drop_mark(*given, dtype, reason) -> list:
    del dtype, reason
    return list(given[:-1])


def _raise_if_marked(*given, dtype, reason) -> list:
    del dtype
    *leaves, mark = given
    return raised_unless_zero(leaves, (mark != 0).astype(int), lambda _: reason)


def _primitive(name: str, call: Callable[..., list], types: Callable[..., list]) -> Primitive:
    made = Primitive(name)
    made.multiple_results = True
    made.def_impl(call)
    made.def_abstract_eval(types)
    mlir.register_lowering(made, mlir.lower_fun(call, multiple_results=True))
    return made


# What goes in gets a mark, and what comes out loses one. Their tangents do so by two linear maps, each of which is the
# transpose of the other: one adds a mark of 0, the other takes one away, and raises where it is not 0. As linear maps
# they are their own derivatives, so that a second derivative is raised like a first one.
_mark, _d_mark = (_primitive(name, _add_mark, _add_type) for name in ("mark", "tangent_of_mark"))
_unmark = _primitive("unmark", _drop_mark, _drop_mark)
_d_unmark = _primitive("tangent_of_unmark", _raise_if_marked, _drop_mark)


def _of_varied(linear: Primitive, tangents, *mark, **how) -> list:
    """The linear map of tangents that are not 0; those that are stay so."""
    varied = [not isinstance(tangent, ad.Zero) for tangent in tangents]
    new = iter(linear.bind(*(x for x, flag in zip(tangents, varied, strict=True) if flag), *mark, **how))
    return [*(next(new) if flag else x for x, flag in zip(tangents, varied, strict=True)), *new]


def _no_mark(dtype) -> ad.Zero:
    return ad.Zero(jax.core.ShapedArray((), dtype))


def _mark_jvp(primals, tangents, **how):
    return _mark.bind(*primals, **how), _of_varied(_d_mark, tangents, **how)


def _unmark_jvp(primals, tangents, **how):
    *tangents, of_mark = tangents
    out = _unmark.bind(*primals, **how)
    return out, tangents if isinstance(of_mark, ad.Zero) else _of_varied(_d_unmark, tangents, of_mark, **how)


def _d_mark_transpose(cotangents, *_, **how):
    *cotangents, of_mark = cotangents
    return cotangents if isinstance(of_mark, ad.Zero) else _of_varied(_d_unmark, cotangents, of_mark, **how)


def _d_unmark_transpose(cotangents, *_, dtype, **how):
    del how
    return [*cotangents, _no_mark(dtype)]


ad.primitive_jvps[_mark] = _mark_jvp
ad.primitive_jvps[_unmark] = _unmark_jvp
ad.deflinear2(_d_mark, _d_mark_transpose)
ad.deflinear2(_d_unmark, _d_unmark_transpose)


def _batch_of_adding(primitive: Primitive):
    """All of a batch has one mark."""
    return lambda given, axes, **how: (primitive.bind(*given, **how), [*axes, None])


def _batch_of_taking(primitive: Primitive):
    """Of a batch the marks are added: one motion is enough."""

    def rule(given, axes, **how):
        *leaves, mark = given
        mark = mark if axes[-1] is None else jnp.sum(mark, axes[-1])
        return primitive.bind(*leaves, mark, **how), list(axes[:-1])

    return rule


for _primitive_that_adds in (_mark, _d_mark):
    batching.primitive_batchers[_primitive_that_adds] = _batch_of_adding(_primitive_that_adds)
for _primitive_that_takes in (_unmark, _d_unmark):
    batching.primitive_batchers[_primitive_that_takes] = _batch_of_taking(_primitive_that_takes)
