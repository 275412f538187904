"""What compares in a trace.

A comparison a > b has one outcome on each side of the surface a - b = 0. So have the choices that are made of one: abs,
max, min, sign and clamp. A floor has a whole number for outcome, which changes where its operand comes to the next one.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.extend.core import JaxprEqn


class Pair(NamedTuple):
    """Two operands that are compared."""

    greater: int
    less: int | None
    """None stands for 0."""
    at_equality: bool | None = None
    """Whether they count as in that order where both are equal; None where the result is the same."""


class Rule(NamedTuple):
    """How an operation is made of comparisons."""

    pairs: tuple[Pair, ...]
    result: Callable[..., Any]
    """The result, given whether each pair is in that order, and the operands."""


def _sign(above, not_below, a):
    """Of what rests at 0 it is 0: two comparisons, which change at one instant where a passes 0."""
    return above.astype(a.dtype) + not_below.astype(a.dtype) - 1


EQUALITIES = {
    "eq": Rule((Pair(0, 1, True), Pair(1, 0, True)), lambda least, most, a, b: least & most),
    "ne": Rule((Pair(0, 1, False), Pair(1, 0, False)), lambda above, below, a, b: above | below),
}
"""They matter where a number may stand still beyond a surface, as max(a, b) - a does; numbers that move are equal at
single points."""

RULES = {
    **EQUALITIES,
    "gt": Rule((Pair(0, 1, False),), lambda above, a, b: above),
    "ge": Rule((Pair(0, 1, True),), lambda above, a, b: above),
    "lt": Rule((Pair(1, 0, False),), lambda above, a, b: above),
    "le": Rule((Pair(1, 0, True),), lambda above, a, b: above),
    "max": Rule((Pair(0, 1),), lambda above, a, b: jnp.where(above, a, b)),
    "min": Rule((Pair(0, 1),), lambda above, a, b: jnp.where(above, b, a)),
    "abs": Rule((Pair(0, None),), lambda above, a: jnp.where(above, a, -a)),
    "sign": Rule((Pair(0, None, False), Pair(0, None, True)), _sign),
    "clamp": Rule(
        (Pair(1, 0), Pair(2, 1)), lambda above, below, low, x, high: jnp.where(above, jnp.where(below, x, high), low)
    ),
}


def compares(equation: JaxprEqn) -> bool:
    """Whether an equation compares real numbers."""
    return equation.primitive.name in RULES and is_real(equation)


def lasts(equation: JaxprEqn, level: int) -> bool:
    """Whether the outcome of a comparison may last, of numbers made from others on so many levels. That of an equality
    may only where one is made from any; x != x asks for nan."""
    if equation.primitive.name not in EQUALITIES:
        return True
    return level > 0 and equation.invars[0] is not equation.invars[1]


def steps(equation: JaxprEqn) -> bool:
    """Whether it is a floor of real numbers."""
    return equation.primitive.name == "floor"


def is_real(equation: JaxprEqn) -> bool:
    """Whether an equation is of real numbers."""
    types: list[Any] = [atom.aval for atom in equation.invars]
    return all(np.issubdtype(each.dtype, np.floating) for each in types)
