"""What each primitive operation of JAX does to jets."""

import math

import jax.numpy as jnp
from jax import lax

from . import inverses
from . import jet as J
from .arithmetic import Interval, outward, point
from .jet import Jet, Truth

LINEAR_SHAPES = {
    "broadcast_in_dim", "concatenate", "copy", "cumsum", "expand_dims", "pad", "reduce_sum", "reshape", "rev", "slice",
    "squeeze", "stack", "transpose",
}  # fmt: skip
"""Operations that move or add up entries and leave the order of numbers."""

PLACED = {
    "gather": (0,), "dynamic_slice": (0,), "scatter": (0, 2), "scatter-add": (0, 2), "dynamic_update_slice": (0, 1),
}  # fmt: skip
"""Operations that read entries at places, or write or add them there, and which of their operands these entries are:
the others tell the places, which must be constant."""

UNARY = {
    "abs": J.absolute,
    "acos": inverses.acos,
    "acosh": inverses.acosh,
    "asin": inverses.asin,
    "asinh": inverses.asinh,
    "atan": inverses.atan,
    "atanh": inverses.atanh,
    "cbrt": inverses.cbrt,
    "cos": J.cos,
    "erf": J.erf,
    "exp": J.exp,
    "log": J.log,
    "logistic": J.logistic,
    "neg": J.negate,
    "sin": J.sin,
    "sqrt": J.sqrt,
    "tanh": J.tanh,
    "sign": lambda a: J.stepwise(jnp.sign, a),
    "floor": lambda a: J.stepwise(jnp.floor, a),
    "ceil": lambda a: J.stepwise(jnp.ceil, a),
    "round": lambda a: J.stepwise(jnp.round, a),
    "square": lambda a: J.integer_power(a, 2),
    "rsqrt": lambda a: J.inverse(J.sqrt(a)),
    "tan": lambda a: J.divide(J.sin(a), J.cos(a)),
    "exp2": lambda a: J.exp(J.scaled_jet(a, math.log(2))),
    "expm1": lambda a: J.subtract(J.exp(a), J.constant(jnp.ones_like(a.value.low))),
    "log1p": lambda a: J.log(J.add(a, J.constant(jnp.ones_like(a.value.low)))),
    "cosh": lambda a: J.scaled_jet(J.add(J.exp(a), J.exp(J.negate(a))), 0.5),
    "sinh": lambda a: J.scaled_jet(J.subtract(J.exp(a), J.exp(J.negate(a))), 0.5),
}

BINARY = {
    "add": J.add,
    "add_any": J.add,
    "sub": J.subtract,
    "mul": J.multiply,
    "div": J.divide,
    "max": J.maximum,
    "min": J.minimum,
    "atan2": inverses.atan2,
    "pow": J.power_by,
    "lt": J.less,
    "le": J.less_or_equal,
    "gt": lambda a, b: J.less(b, a),
    "ge": lambda a, b: J.less_or_equal(b, a),
    "eq": J.equal,
    "ne": lambda a, b: J.negation(J.equal(a, b)),
}
"""Operations entry by entry."""

LOGIC = {
    "and": lambda a, b: Truth(a.sure & b.sure, a.possible & b.possible),
    "or": lambda a, b: Truth(a.sure | b.sure, a.possible | b.possible),
    "not": J.negation,
}


COMPARISONS = {
    "eq": lambda a, b: Truth((a.sure & b.sure) | ~(a.possible | b.possible), ~_differ(a, b)),
    "ne": lambda a, b: Truth(_differ(a, b), (a.possible | b.possible) & ~(a.sure & b.sure)),
}
"""Of two conditions."""


def _differ(a: Truth, b: Truth):
    """Where one surely holds and the other surely does not."""
    return (a.sure & ~b.possible) | (b.sure & ~a.possible)


def dot_general(a: Jet, b: Jet, params) -> Jet:
    """A sum of products, by middles and radii: entries of the second are met by none of the first's signs."""
    contract = lambda x, y: lax.dot_general(
        x, y, params["dimension_numbers"], preferred_element_type=params["preferred_element_type"]
    )
    (contracted, _), _ = params["dimension_numbers"]
    if a is b and a.value.low.ndim == 1 and contracted:  # not their outer product, and not the product of each entry
        return J.linear(jnp.sum, J.integer_power(a, 2))

    def product(x: Interval | None, y: Interval | None):
        if x is None or y is None:
            return None
        (x_mid, x_radius), (y_mid, y_radius) = _ball(x), _ball(y)
        rounded = jnp.finfo(x_mid.dtype).eps * max(x_mid.size, y_mid.size)
        size = jnp.abs(y_mid) if y_radius is None else jnp.abs(y_mid) + y_radius
        spread = rounded * size if y_radius is None else y_radius + rounded * size
        middle, radius = contract(x_mid, y_mid), contract(jnp.abs(x_mid), spread)
        if x_radius is not None:
            radius = radius + contract(x_radius, size)
        return outward(middle - radius, middle + radius)

    return J.bilinear(product, a, b)


def _ball(a: Interval):
    """Middle and radius; the radius takes up what the middle rounds, and is None for an exact number."""
    if a.exact:
        return a.low, None
    middle = 0.5 * (a.low + a.high)
    return middle, jnp.maximum(a.high - middle, middle - a.low)


def select(which, cases: list[Jet]) -> Jet:
    """`lax.select_n`: by a condition on jets, or by constants."""
    if isinstance(which, Truth):
        truth = Truth(*(jnp.broadcast_to(x, cases[0].value.low.shape) for x in which))
        return J.chosen(truth, cases[1], cases[0], kink=False)
    pick = lambda *parts: lax.select_n(which, *parts)
    zero = point(jnp.zeros_like(cases[0].value.low))
    parts = []
    for all_parts in zip(*cases, strict=True):
        filled = [part or zero for part in all_parts]
        nothing = all(part is None for part in all_parts)
        parts.append(None if nothing else Interval(pick(*(p.low for p in filled)), pick(*(p.high for p in filled))))
    return Jet(*parts)


def select_condition(which, cases: list[Truth]) -> Truth:
    """The same of conditions."""
    if not isinstance(which, Truth):
        return Truth(*(lax.select_n(which, *parts) for parts in zip(*cases, strict=True)))
    a, b = cases
    sure = (which.sure & b.sure) | (~which.possible & a.sure) | (a.sure & b.sure)
    return Truth(sure, (which.possible & b.possible) | (~which.sure & a.possible))
