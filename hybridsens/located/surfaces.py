"""Where outcomes change, and what stands for an equation that compares once they are held: a choice by them.

Each kind of choice is traced once, and called wherever it is met: a trace compares in the same way many times.
"""

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.core
from jax.extend.core import JaxprEqn, Var

from ..xla.rewriting import calling
from .rules import RULES


class Surface(NamedTuple):
    """Where an outcome changes."""

    greater: Any
    less: Any | None
    at_equality: bool
    """The outcome where both are equal."""
    start: int
    """Where its outcomes stand among all."""
    shape: tuple[int, ...]


class Step(NamedTuple):
    """A floor."""

    of: Any
    start: int
    """Where its outcomes stand among all."""
    shape: tuple[int, ...]


class Rows(NamedTuple):
    """The outcomes of a surface among all."""

    start: int
    shape: tuple[int, ...]
    turned: bool
    """Whether the surface is asked for the other way round."""


def room(known: dict[Any, Any]) -> int:
    """How many outcomes surfaces or floors have."""
    return sum(math.prod(each.shape) for each in known.values())


def difference(surface: Surface) -> JaxprEqn:
    """The equation that tells on which side of a surface one is, and how far."""
    given = [surface.greater, *([] if surface.less is None else [surface.less])]
    result = Var(jax.core.ShapedArray(surface.shape, surface.greater.aval.dtype))
    return _difference(*(operand.aval for operand in given)).replace(invars=given, outvars=[result])


def floored(step: Step, whole: Var, equation: JaxprEqn) -> JaxprEqn:
    """What stands for a floor: its row of the whole numbers."""
    kind: Any = equation.outvars[0].aval
    return _row(step.start, step.shape, whole.aval, kind.dtype).replace(invars=[whole], outvars=equation.outvars)


def chosen(surfaces: list[tuple[Surface, bool]], above: Var, equation: JaxprEqn) -> JaxprEqn:
    """What stands for a comparison: its result by the outcomes. With each surface goes whether it is asked for the
    other way round."""
    rows = tuple(Rows(surface.start, surface.shape, turned) for surface, turned in surfaces)
    operands: list[Any] = [above, *equation.invars]
    kind: Any = equation.outvars[0].aval
    choice = _choice(equation.primitive.name, rows, kind.dtype, *(operand.aval for operand in operands))
    return choice.replace(invars=operands, outvars=equation.outvars)


@functools.lru_cache(maxsize=1024)
def _difference(*kinds) -> JaxprEqn:
    return calling(lambda greater, less=0.0: greater - less, kinds)


@functools.lru_cache(maxsize=1024)
def _row(start: int, shape: tuple[int, ...], kind, dtype) -> JaxprEqn:
    return calling(lambda whole: _rows(whole, start, shape).astype(dtype), [kind])


@functools.lru_cache(maxsize=1024)
def _choice(name: str, rows: tuple[Rows, ...], dtype, *kinds) -> JaxprEqn:
    def result(above, *operands):
        in_order = [_rows(above, row.start, row.shape) ^ row.turned for row in rows]
        return RULES[name].result(*in_order, *operands).astype(dtype)

    return calling(result, kinds)


def _rows(outcomes: jax.Array, start: int, shape: tuple[int, ...]) -> jax.Array:
    """Those of a surface or a floor, in its shape."""
    return outcomes[start : start + math.prod(shape)].reshape(shape)
