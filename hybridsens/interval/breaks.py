"""Kinks and jumps of a traced function, told from its trace alone.

A forward walk over the trace carries, for every intermediate result, the names of the inputs that it depends on and the
operations without a derivative on the way there. A break that the function's outcome does not depend on is not told.
"""

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np

from .enclosure import CALLS, inner_jaxpr
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


KINKS = {
    "abs": "jnp.abs", "clamp": "jnp.clip", "max": "jnp.maximum", "min": "jnp.minimum", "reduce_max": "jnp.max",
    "reduce_min": "jnp.min", "cummax": "lax.cummax", "cummin": "lax.cummin", "sort": "jnp.sort",
}  # fmt: skip
JUMPS = {
    "sign": "jnp.sign", "floor": "jnp.floor", "ceil": "jnp.ceil", "round": "jnp.round", "rem": "%",
    "argmax": "jnp.argmax", "argmin": "jnp.argmin",
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


def breaks(closed_jaxpr, inputs: Sequence[str | None]) -> frozenset[Break]:
    """Kinks and jumps of a function in the named ones of its inputs; None names an input that does not move."""
    walk = _Walk()
    moving = [NONE if name is None else frozenset([name]) for name in inputs]
    named = [Trait(names, key=walk.key("input", k)) for k, names in enumerate(moving)]
    results = walk.run(closed_jaxpr.jaxpr, [Trait()] * len(closed_jaxpr.jaxpr.constvars), named)
    return frozenset().union(*(result.breaks for result in results))


class _Walk:
    """One walk over a trace and the traces inside it."""

    def __init__(self):
        self._keys: dict[Hashable, int] = {}

    def key(self, *expression) -> int:
        """A number for an expression; equal ones have equal numbers."""
        return self._keys.setdefault(expression, len(self._keys))

    def run(self, jaxpr, constants: list[Trait], arguments: list[Trait]) -> list[Trait]:
        known = dict(zip((*jaxpr.constvars, *jaxpr.invars), (*constants, *arguments), strict=True))
        read = lambda atom: _literal(atom.val) if hasattr(atom, "val") else known[atom]
        for equation in jaxpr.eqns:
            operands = [read(atom) for atom in equation.invars]
            known.update(zip(equation.outvars, self._results(equation, operands), strict=True))
        return [read(atom) for atom in jaxpr.outvars]

    def _results(self, equation, operands: list[Trait]) -> list[Trait]:
        name = equation.primitive.name
        if not any(operand.inputs for operand in operands):
            return [_unmoved(name, operands)] * len(equation.outvars)
        if name in CALLS:
            return self._call(equation, operands)
        if name == "cond":
            return self._cond(equation, operands)
        if name in {"while", "scan"}:
            return self._loop(equation, operands)
        return [self._result(equation, operands, variable) for variable in equation.outvars]

    def _result(self, equation, operands: list[Trait], variable) -> Trait:
        """Result of an operation that holds no other program."""
        name = equation.primitive.name
        together = _union(operands)
        # Equality of real numbers guards single points, and pivots pick an order of equations: nothing moves there.
        if name == "is_finite" or (name in {"eq", "ne"} and not _is_integer(equation.invars[0])):
            return Trait()
        if name in {"lu", "lu_pivots_to_permutation"} and np.issubdtype(variable.aval.dtype, np.integer):
            return Trait()
        if name == "stop_gradient":  # the shift by a maximum inside of softmax and logsumexp
            return Trait(together.inputs)
        smoothed = together.breaks - _smoothed(name, equation, operands)
        own = _own_break(name, equation, operands, variable)
        key = self._key_of(name, equation, operands)
        return Trait(together.inputs, smoothed | own, key, _is_nonnegative(name, equation, operands))

    def _key_of(self, name: str, equation, operands: list[Trait]) -> Hashable:
        moving = [operand for operand in operands if operand.inputs]
        if len(moving) == 1:
            scaled = name in {"mul", "neg", "abs"} or (name == "div" and operands[0].inputs)
            if scaled or (name in {"max", "min"} and _has_zero(equation)):
                return moving[0].key
            if name in SHAPES:
                return self.key(name, str(equation.params), moving[0].key)
        return self.key(object())  # an expression of its own

    def _call(self, equation, operands: list[Trait]) -> list[Trait]:
        jaxpr, constants = inner_jaxpr(equation)
        name = equation.params.get("name") or getattr(jaxpr.debug_info, "func_name", "")
        if name in SMOOTH_CALLS:
            return [Trait(_union(operands).inputs, _union(operands).breaks)] * len(equation.outvars)
        results = self.run(jaxpr, [Trait()] * len(constants), operands)
        title, jump = KINKED_CALLS.get(name), False
        if title is None:
            title, jump = JUMPING_CALLS.get(name), True
        if title is None:
            return results
        before = _union(operands).breaks
        rename = lambda b: b if b in before else Break(title, b.inputs, jump, b.zero_of)
        return [result._replace(breaks=frozenset(map(rename, result.breaks))) for result in results]

    def _cond(self, equation, operands: list[Trait]) -> list[Trait]:
        which, *given = operands
        branches = [self.run(b.jaxpr, [Trait()] * len(b.consts), given) for b in equation.params["branches"]]
        own = frozenset([Break("lax.cond", which.inputs, True)] if which.inputs else [])
        choose = lambda *results: Trait(_union([which, *results]).inputs, _union([which, *results]).breaks | own)
        return [choose(*results) for results in zip(*branches, strict=True)]

    def _loop(self, equation, operands: list[Trait]) -> list[Trait]:
        """A loop's body is walked until what is carried depends on nothing more."""
        params = equation.params
        if equation.primitive.name == "scan":
            body = params["jaxpr"]
            carried, fixed = _counts_in_scan(equation, body.jaxpr)
            constants = operands[:fixed]
        else:  # how often a `while` turns is no break: it ends where its outcome is as exact as wanted
            body, fixed = params["body_jaxpr"], params["cond_nconsts"] + params["body_nconsts"]
            constants, carried = operands[params["cond_nconsts"] : fixed], len(operands) - fixed
        plain = lambda trait: Trait(trait.inputs, frozenset(b._replace(zero_of=None) for b in trait.breaks))
        carry, rows = [plain(x) for x in operands[fixed : fixed + carried]], operands[fixed + carried :]
        while True:
            results = self.run(body.jaxpr, [Trait()] * len(body.consts), [*map(plain, constants), *carry, *rows])
            wider = [plain(_union([old, new])) for old, new in zip(carry, results[:carried], strict=True)]
            if wider == carry:
                return [*carry, *map(plain, results[carried:])]
            carry = wider


def _counts_in_scan(equation, body) -> tuple[int, int]:
    """How much a scan carries, and how many constants come before that. What it goes through row by row has one axis
    more outside than in its body. (JAX has no name for these numbers that all of its versions know.)"""
    whole = lambda outside, inside: sum(a.aval.ndim == b.aval.ndim for a, b in zip(outside, inside, strict=True))
    carried = whole(equation.outvars, body.outvars)
    return carried, whole(equation.invars, body.invars) - carried


def _own_break(name: str, equation, operands: list[Trait], variable) -> frozenset[Break]:
    """The break that an operation makes itself. Integers and truths break nothing before they become real numbers."""
    inputs = _union(operands).inputs
    if not np.issubdtype(variable.aval.dtype, np.inexact) or (name in {"abs", "sign"} and operands[0].nonnegative):
        return frozenset()
    if name in KINKS:
        moving = [operand for operand in operands if operand.inputs]
        at_zero = len(moving) == 1 and (name == "abs" or (name in {"max", "min"} and _has_zero(equation)))
        return frozenset([Break(KINKS[name], inputs, False, moving[0].key if at_zero else None)])
    if name in JUMPS:
        return frozenset([Break(JUMPS[name], inputs, True)])
    if name == "select_n" and operands[0].inputs:
        return frozenset([Break("jnp.where", operands[0].inputs, True)])
    places = _union([o for o, atom in zip(operands, equation.invars, strict=True) if _is_integer(atom)]).inputs
    if name in INDEXED and places:
        return frozenset([Break("an index that moves", places, True)])
    if name == "convert_element_type" and places:
        return frozenset([Break("a comparison or an integer used as a number", places, True)])
    return frozenset()


def _smoothed(name: str, equation, operands: list[Trait]) -> frozenset[Break]:
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


def _is_nonnegative(name: str, equation, operands: list[Trait]) -> bool:
    if name == "integer_pow":
        return equation.params["y"] % 2 == 0
    if name in {"mul", "dot_general"} and equation.invars[0] is equation.invars[1]:
        return name == "mul" or len(equation.invars[0].aval.shape) == 1
    some = any(operand.nonnegative for operand in operands)
    return name in POSITIVE or (name == "max" and some) or (name in SUMS and all(o.nonnegative for o in operands))


def _unmoved(name: str, operands: list[Trait]) -> Trait:
    return Trait(nonnegative=name in SUMS and bool(operands) and all(operand.nonnegative for operand in operands))


def _literal(value) -> Trait:
    return Trait(nonnegative=bool(np.all(np.asarray(value) >= 0)))


def _has_zero(equation) -> bool:
    return any(hasattr(atom, "val") and not np.any(np.asarray(atom.val)) for atom in equation.invars)


def _is_integer(atom) -> bool:
    return not np.issubdtype(atom.aval.dtype, np.inexact)


def _union(traits: Sequence[Trait]) -> Trait:
    inputs = frozenset().union(*(trait.inputs for trait in traits))
    return Trait(inputs, frozenset().union(*(trait.breaks for trait in traits)))
