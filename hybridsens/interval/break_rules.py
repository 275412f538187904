"""What one operation of a trace says of kinks and jumps: which it makes, which it removes, where numbers are equal."""

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np

from .primitives import LINEAR_SHAPES
from .tables import NAMES as INTERPOLATIONS

Names = frozenset[str]
NONE: Names = frozenset()


class Break(NamedTuple):
    """An operation whose outcome has a kink or a jump."""

    operation: str
    """As the user writes it."""
    inputs: Names
    """Names of the inputs that its place depends on."""
    jump: bool
    """Whether the outcome may jump; else it has a kink."""
    zero_of: Hashable = None
    """The kink lies where this key's expression is 0; None where the place is not known."""


class Trait(NamedTuple):
    """What is known of an intermediate result."""

    inputs: Names = NONE
    """Names of the inputs that it depends on."""
    breaks: frozenset[Break] = frozenset()
    """Breaks on the way to it."""
    key: Hashable = None
    """Results with one key are 0 at the same places (constant factors, `abs` and `max(x, 0)` keep the key)."""
    nonnegative: bool = False
    root: Hashable = None
    """Key of what it is the square of."""


KINKS = {
    "abs": "jnp.abs", "clamp": "jnp.clip", "max": "jnp.maximum", "min": "jnp.minimum", "reduce_max": "jnp.max",
    "reduce_min": "jnp.min", "cummax": "lax.cummax", "cummin": "lax.cummin", "sort": "jnp.sort",
    "top_k": "lax.top_k", "scatter_max": ".at[].max", "scatter_min": ".at[].min", "scatter-max": ".at[].max",
    "scatter-min": ".at[].min",
}  # fmt: skip
JUMPS = {
    "sign": "jnp.sign", "floor": "jnp.floor", "ceil": "jnp.ceil", "round": "jnp.round", "rem": "%",
    "argmax": "jnp.argmax", "argmin": "jnp.argmin", "atan2": "jnp.arctan2",
}  # fmt: skip
INDEXED = {"gather", "dynamic_slice", "dynamic_update_slice", "scatter", "scatter-add", "scatter_add"}
SMOOTH_CALLS = {"logaddexp", "logaddexp2", "hypot", "sinc", "nextafter", "_det_2x2", "_det_3x3", "_distance_to_polygon"}
"""Functions of JAX, and one of `planar`, that are smooth, although they select inside (`hypot` but for the origin, a
determinant its pivot, the distance to a polygon but for its inside)."""
KINKED_CALLS = dict.fromkeys(INTERPOLATIONS, "jnp.interp") | {"clip": "jnp.clip", "relu": "relu"}
JUMPING_CALLS = {"remainder": "%", "floor_divide": "//", "searchsorted": "jnp.searchsorted", "digitize": "jnp.digitize"}
SHAPES = (LINEAR_SHAPES - {"cumsum", "reduce_sum", "concatenate", "stack", "pad"}) | {"neg"}
POSITIVE = {"exp", "exp2", "logistic", "cosh", "square", "sqrt", "abs"}
SUMS = {"add", "add_any", "mul", "div", "reduce_sum", "max"} | SHAPES - {"neg"}
"""Operations that make nonnegative numbers of nonnegative numbers."""
KEEP_ENTRIES = {"broadcast_in_dim", "copy", "expand_dims", "reduce_sum", "reshape", "squeeze"}
"""Operations that leave entries in their order, if there are as many after them."""


def own_break(name: str, equation, operands: list[Trait], variable) -> frozenset[Break]:
    """The break that an operation makes itself. Integers and truths break nothing before they become real numbers."""
    inputs = union(operands).inputs
    if not np.issubdtype(variable.aval.dtype, np.inexact) or (name in {"abs", "sign"} and operands[0].nonnegative):
        return frozenset()
    if name == "sort" and equation.outvars.index(variable) >= equation.params["num_keys"]:
        return frozenset([Break("what is sorted by other numbers", inputs, True)])
    if name in KINKS:
        moving = [operand for operand in operands if operand.inputs]
        at_zero = len(moving) == 1 and (name == "abs" or (name in {"max", "min"} and has_zero(equation)))
        return frozenset([Break(KINKS[name], inputs, False, moving[0].key if at_zero else None)])
    if name == "sqrt" and operands[0].root is not None:
        return frozenset([Break("the root of a square", inputs, False, operands[0].root)])
    if name == "atan2" and operands[1].nonnegative:
        return frozenset()
    if name in JUMPS:
        return frozenset([Break(JUMPS[name], inputs, True)])
    if name == "select_n" and operands[0].inputs:
        return frozenset([Break("jnp.where", operands[0].inputs, True)])
    places = union([o for o, atom in zip(operands, equation.invars, strict=True) if is_integer(atom)]).inputs
    if name in INDEXED and places:
        return frozenset([Break("an index that moves", places, True)])
    if name == "convert_element_type" and places:
        return frozenset([Break("a comparison or an integer used as a number", places, True)])
    return frozenset()


def where_equal(equation, operands: list[Trait]) -> Names:
    """What moves the places where two real numbers begin or cease to be equal.

    Nothing, if both are smooth: they are equal at single points. A number that stands still beyond a break, as
    max(x, 0) does, may be equal to another one for long; |x| does not stand still. x != x asks for nan."""
    if equation.invars[0] is equation.invars[1]:
        return NONE
    both_move = all(operand.inputs for operand in operands)
    still = {b for b in union(operands).breaks if both_move or b.operation != KINKS["abs"]}
    return frozenset().union(*(b.inputs for b in still))


def root(name: str, equation, operands: list[Trait]) -> Hashable:
    """Key of what a result is the square of, number by number; None for other results."""
    if equation.invars[0].aval.size != equation.outvars[0].aval.size:
        return None
    if is_square(equation):
        return operands[0].key
    return operands[0].root if name in KEEP_ENTRIES else None


def is_square(equation) -> bool:
    """Whether an operation squares numbers."""
    name = equation.primitive.name
    by_itself = name == "mul" and equation.invars[0] is equation.invars[1]
    return by_itself or name == "square" or (name == "integer_pow" and equation.params["y"] == 2)


def smoothed(name: str, equation, operands: list[Trait]) -> frozenset[Break]:
    """Kinks that lie where a factor is 0, as in v |v| or max(x, 0)^2: the derivative exists there."""
    power = {"square": 2, "integer_pow": equation.params.get("y", 0)}.get(name, 0)
    if name == "pow" and hasattr(equation.invars[1], "val"):
        power = float(equation.invars[1].val)
    if power > 1:
        return frozenset(b for b in operands[0].breaks if b.zero_of is not None and b.zero_of == operands[0].key)
    if name != "mul":
        return frozenset()
    pairs = [(operands[0], operands[1]), (operands[1], operands[0])]
    return frozenset(b for x, y in pairs for b in x.breaks if b.zero_of is not None and b.zero_of == y.key)


def is_nonnegative(name: str, equation, operands: list[Trait]) -> bool:
    """Whether no result of an operation is below 0, as far as its operands tell."""
    if name == "integer_pow":
        return equation.params["y"] % 2 == 0
    if name in {"mul", "dot_general"} and equation.invars[0] is equation.invars[1]:
        return name == "mul" or len(equation.invars[0].aval.shape) == 1
    some = any(operand.nonnegative for operand in operands)
    return name in POSITIVE or (name == "max" and some) or (name in SUMS and all(o.nonnegative for o in operands))


def unmoved(name: str, operands: list[Trait]) -> Trait:
    """What is known of a result of operands that do not move."""
    return Trait(nonnegative=name in SUMS and bool(operands) and all(operand.nonnegative for operand in operands))


def of_number(value) -> Trait:
    """What is known of a number in the program."""
    return Trait(nonnegative=bool(np.all(np.asarray(value) >= 0)))


def has_zero(equation) -> bool:
    """Whether an operand is a 0 that is written in the program."""
    return any(hasattr(atom, "val") and not np.any(np.asarray(atom.val)) for atom in equation.invars)


def is_integer(atom) -> bool:
    """Whether it is an integer or a truth value."""
    return not np.issubdtype(atom.aval.dtype, np.inexact)


def union(traits: Sequence[Trait]) -> Trait:
    """The inputs and the breaks of several results together."""
    inputs = frozenset().union(*(trait.inputs for trait in traits))
    return Trait(inputs, frozenset().union(*(trait.breaks for trait in traits)))
