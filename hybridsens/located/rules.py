"""What compares in a trace, and what each such operation is made of.

A comparison a > b has one outcome on each side of the surface a - b = 0. So have the choices that are made of one: abs,
max, min, sign and clamp; the largest of several numbers is made of choices between two. A floor has a whole number for
outcome, which changes where its operand comes to the next one; ceil, round and remainders are made of floors.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Jaxpr, JaxprEqn, Literal

from ..interval.breaks import INTERPOLATIONS, JUMPING_CALLS, SMOOTH_CALLS
from ..interval.enclosure import CALLS, inner_jaxpr
from ..interval.repeats import Distinct, needed_for


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


RULES = {
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

BY_FLOORS = {
    "ceil": lambda x: -jnp.floor(-x),
    "round": lambda x: jnp.floor(x + 0.5),
    "rem": lambda x, y: x - y * jnp.trunc(x / y),
}
"""Operations that are made of floors. Halves are rounded up, where JAX rounds them to the even number."""

NEUTRAL = {"max": -math.inf, "min": math.inf}
"""An operand that never counts: softmax has one."""

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


def compares(equation: JaxprEqn) -> bool:
    """Whether an equation compares real numbers."""
    return equation.primitive.name in RULES and _is_real(equation)


def steps(equation: JaxprEqn) -> bool:
    """Whether it is a floor of real numbers."""
    return equation.primitive.name == "floor"


class Flat(Distinct):
    """The equations of a trace, and of those calls that compare inside, each once, with floors for what steps."""

    def __init__(self):
        super().__init__()
        self._shifts: set[Any] = set()
        """Results of largest numbers by which only an exponent is shifted."""

    def _run(self, jaxpr: Jaxpr, given: list[Any]) -> list[Any]:
        # In softmax and logsumexp: what is shifted by a number without a derivative is smooth as a whole.
        _, needed = needed_for([e for e in jaxpr.eqns if e.primitive.name != "stop_gradient"], jaxpr.outvars)
        largest = (e.outvars[0] for e in jaxpr.eqns if e.primitive.name == "reduce_max")
        self._shifts.update(result for result in largest if result not in needed)
        return super()._run(jaxpr, given)

    def goes_inside(self, equation: JaxprEqn) -> bool:
        if self._shifts.intersection(equation.outvars):
            return False
        return _made_of(equation) is not None or (_is_call(equation) and _compares_inside(equation))

    def _call(self, equation: JaxprEqn, operands: list[Any]) -> list[Any]:
        """As of the program that it calls, or of the one that it is made of."""
        made_of = _made_of(equation)
        if made_of is None:
            return super()._call(equation, operands)
        program = jax.make_jaxpr(made_of)(*(operand.aval for operand in equation.invars))
        return self._run(program.jaxpr, [*self._constants(program), *operands])


def _made_of(equation: JaxprEqn) -> Callable | None:
    """The same by operations that have a rule; None for one that has, or that cannot be made of such."""
    name = _name(equation)
    if _is_call(equation):
        return CALLS_BY_FLOORS[name] if name in CALLS_BY_FLOORS and _divides(equation) else None
    if name in BY_FLOORS and _is_real(equation):
        return BY_FLOORS[name]
    neutral = [k for k, x in enumerate(equation.invars) if name in NEUTRAL and _is_neutral(x, NEUTRAL[name])]
    if neutral:
        return lambda *operands: operands[1 - neutral[0]]
    which = BEFORE.get(name)
    if which is None or not _is_real(equation):
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
    return _is_real(equation) and {"rem", "select_n"} <= set(inside)


def _first(before: Callable, x: jax.Array, axes: Sequence[int]) -> dict[str, jax.Array]:
    """The number that comes before all others along some axes, and where it is: the winners of pairs meet."""
    rows = jnp.moveaxis(x, axes, range(len(axes))).reshape(-1, *(n for k, n in enumerate(x.shape) if k not in axes))
    left = [{"value": row, "index": jnp.full(row.shape, k)} for k, row in enumerate(rows)]
    while len(left) > 1:
        pairs = list(zip(left[::2], left[1::2], strict=False))
        met = [jax.tree.map(functools.partial(jnp.where, before(a["value"], b["value"])), a, b) for a, b in pairs]
        left = [*met, *left[2 * len(pairs) :]]
    return left[0]


def _compares_inside(equation: JaxprEqn) -> bool:
    """Whether a call compares real numbers, by itself or in another call inside."""
    if _name(equation) in OPAQUE:
        return False
    jaxpr, _ = inner_jaxpr(equation)
    inside = lambda inner: _is_call(inner) and _compares_inside(inner)
    known = lambda inner: compares(inner) or steps(inner) or _made_of(inner) is not None
    return any(known(inner) or inside(inner) for inner in jaxpr.eqns)


def _name(equation: JaxprEqn) -> str:
    """Of an operation; of a call that of its function."""
    if not _is_call(equation):
        return equation.primitive.name
    return equation.params.get("name") or getattr(inner_jaxpr(equation)[0].debug_info, "func_name", "")


def _is_call(equation: JaxprEqn) -> bool:
    return equation.primitive.name in CALLS


def _is_real(equation: JaxprEqn) -> bool:
    is_real = lambda atom: np.issubdtype(atom.aval.dtype, np.floating)
    return all(map(is_real, equation.invars))
