"""What is made of comparisons and floors, operation by operation and call by call.

The largest of several numbers is made of choices between two; ceil, round and remainders are made of floors; the angle
of a point is made of that in each half of the plane.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import JaxprEqn, Literal

from ..interval.break_rules import INTERPOLATIONS, JUMPING_CALLS, SMOOTH_CALLS
from ..interval.calls import CALLS, called, inner_jaxpr
from .rules import compares, is_real, steps

BY_FLOORS = {
    "ceil": lambda x: -jnp.floor(-x),
    "round": lambda x: jnp.floor(x + 0.5),
    "rem": lambda x, y: x - y * jnp.trunc(x / y),
}
"""Operations that are made of floors. Halves are rounded up, where JAX rounds them to the even number."""

NEUTRAL = {"max": -math.inf, "min": math.inf}
"""An operand that never counts: softmax has one."""


def _direction(y, x):
    """The angle of (x, y), in each half of the plane by a formula that is smooth there, and goes on beyond it.

    It jumps where y passes 0 on the left. At the origin it is 0."""
    right = x >= 0
    far = jnp.sqrt(x**2 + y**2) + jnp.where(right, x, -x) + jnp.finfo(x.dtype).tiny
    from_axis = 2 * jnp.arctan(y / far)  # from the half of the axis that is nearer
    return jnp.where(right, from_axis, jnp.where(y >= 0, jnp.pi, -jnp.pi) - from_axis)


BY_COMPARISONS = BY_FLOORS | {"atan2": _direction}
"""Operations that are made of comparisons or floors."""

CALLS_BY_FLOORS = {
    "remainder": lambda x, y: x - y * jnp.floor(x / y),
    "floor_divide": lambda x, y: jnp.floor(x / y),
    "divmod": lambda x, y: (jnp.floor(x / y), x - y * jnp.floor(x / y)),
}
"""Functions of JAX that are, by the names of their calls."""

BEFORE = {
    "reduce_max": jnp.greater_equal,
    "argmax": jnp.greater_equal,
    "reduce_min": jnp.less_equal,
    "argmin": jnp.less_equal,
}
"""Which of two numbers is the one that is looked for among many."""

MOST = 16
"""Of how many numbers it is found by comparisons of two."""

OPAQUE = SMOOTH_CALLS | (JUMPING_CALLS.keys() - CALLS_BY_FLOORS.keys()) | set(INTERPOLATIONS)
"""Functions of JAX that are smooth although they compare inside, or whose place is not where one number is another."""


def made_of(equation: JaxprEqn) -> Callable | None:
    """The same by operations that have a rule; None for one that has, or that cannot be made of such."""
    name = name_of(equation)
    if is_call(equation):
        return CALLS_BY_FLOORS[name] if name in CALLS_BY_FLOORS and _divides(equation) else None
    if name in BY_COMPARISONS and is_real(equation):
        return BY_COMPARISONS[name]
    neutral = [k for k, x in enumerate(equation.invars) if name in NEUTRAL and _is_neutral(x, NEUTRAL[name])]
    if neutral:
        return lambda *operands: operands[1 - neutral[0]]
    which = BEFORE.get(name)
    if which is None or not is_real(equation):
        return None
    given: Any = equation.invars[0].aval
    made: Any = equation.outvars[0].aval
    if not 1 < math.prod(given.shape[axis] for axis in equation.params["axes"]) <= MOST:
        return None
    result = "index" if name.startswith("arg") else "value"
    return lambda x: _first(which, x, equation.params["axes"])[result].astype(made.dtype)


def _is_neutral(operand: Any, neutral: float) -> bool:
    return isinstance(operand, Literal) and bool(np.all(np.asarray(operand.val) == neutral))


def _divides(equation: JaxprEqn) -> bool:
    """Whether a call is that of JAX, and not of another function of that name."""
    inside = [inner.primitive.name for inner in inner_jaxpr(equation)[0].eqns]
    return is_real(equation) and {"rem", "select_n"} <= set(inside)


def _first(before: Callable, x: jax.Array, axes: Sequence[int]) -> dict[str, jax.Array]:
    """The number that comes before all others along some axes, and where it is: the winners of pairs meet."""
    rows = jnp.moveaxis(x, axes, range(len(axes))).reshape(-1, *(n for k, n in enumerate(x.shape) if k not in axes))
    left = [{"value": row, "index": jnp.full(row.shape, k)} for k, row in enumerate(rows)]
    while len(left) > 1:
        pairs = list(zip(left[::2], left[1::2], strict=False))
        met = [jax.tree.map(functools.partial(jnp.where, before(a["value"], b["value"])), a, b) for a, b in pairs]
        left = [*met, *left[2 * len(pairs) :]]
    return left[0]


def compares_inside(equation: JaxprEqn) -> bool:
    """Whether a call compares real numbers, by itself or in another call inside."""
    if name_of(equation) in OPAQUE:
        return False
    jaxpr, _ = inner_jaxpr(equation)
    inside = lambda inner: is_call(inner) and compares_inside(inner)
    made = lambda inner: made_of(inner) is not None or inner.primitive.name == "sqrt"  # maybe of a square
    known = lambda inner: compares(inner) or steps(inner) or made(inner)
    return any(known(inner) or inside(inner) for inner in jaxpr.eqns)


def name_of(equation: JaxprEqn) -> str:
    """Of an operation; of a call that of its function, if it is known."""
    return called(equation) if is_call(equation) else equation.primitive.name


def is_call(equation: JaxprEqn) -> bool:
    """Whether it calls another program."""
    return equation.primitive.name in CALLS
