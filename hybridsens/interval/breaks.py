"""Kinks and jumps of a traced function, told from its trace alone.

A forward walk over the trace carries, for every intermediate result, the names of the inputs that it depends on and the
operations without a derivative on the way there. A break that the function's outcome does not depend on is not told.
"""

from collections.abc import Hashable, Sequence

import numpy as np

from .break_rules import (
    JUMPING_CALLS,
    KINKED_CALLS,
    NONE,
    SHAPES,
    SMOOTH_CALLS,
    Break,
    Trait,
    has_zero,
    is_integer,
    is_nonnegative,
    of_number,
    own_break,
    root,
    smoothed,
    union,
    unmoved,
    where_equal,
)
from .calls import CALLS, called, inner_jaxpr, walked


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
        return walked(jaxpr, (*constants, *arguments), lambda atom: of_number(atom.val), self._results)

    def _results(self, equation, operands: list[Trait]) -> list[Trait]:
        name = equation.primitive.name
        if not any(operand.inputs for operand in operands):
            return [unmoved(name, operands)] * len(equation.outvars)
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
        together = union(operands)
        if name == "is_finite":
            return Trait()
        if name in {"eq", "ne"} and not is_integer(equation.invars[0]):
            return Trait(where_equal(equation, operands))
        # Pivots pick an order of equations: nothing moves there.
        if name in {"lu", "lu_pivots_to_permutation"} and np.issubdtype(variable.aval.dtype, np.integer):
            return Trait()
        if name == "stop_gradient":  # the shift by a maximum inside of softmax and logsumexp is a kink of nothing
            return Trait(together.inputs, frozenset(b for b in together.breaks if b.jump))
        left = together.breaks - smoothed(name, equation, operands)
        own = own_break(name, equation, operands, variable)
        key = self._key_of(name, equation, operands)
        square_of = root(name, equation, operands)
        return Trait(together.inputs, left | own, key, is_nonnegative(name, equation, operands), square_of)

    def _key_of(self, name: str, equation, operands: list[Trait]) -> Hashable:
        moving = [operand for operand in operands if operand.inputs]
        if len(moving) == 1:
            scaled = name in {"mul", "neg", "abs"} or (name == "div" and operands[0].inputs)
            if scaled or (name in {"max", "min"} and has_zero(equation)):
                return moving[0].key
            if name == "sqrt" and moving[0].root is not None:
                return moving[0].root
            if name in SHAPES:
                return self.key(name, str(equation.params), moving[0].key)
        return self.key(object())  # an expression of its own

    def _call(self, equation, operands: list[Trait]) -> list[Trait]:
        jaxpr, constants = inner_jaxpr(equation)
        name = called(equation)
        if name in SMOOTH_CALLS:
            return [Trait(union(operands).inputs, union(operands).breaks)] * len(equation.outvars)
        results = self.run(jaxpr, [Trait()] * len(constants), operands)
        title, jump = KINKED_CALLS.get(name), False
        if title is None:
            title, jump = JUMPING_CALLS.get(name), True
        if title is None:
            return results
        before = union(operands).breaks
        rename = lambda b: b if b in before else Break(title, b.inputs, jump, b.zero_of)
        return [result._replace(breaks=frozenset(map(rename, result.breaks))) for result in results]

    def _cond(self, equation, operands: list[Trait]) -> list[Trait]:
        which, *given = operands
        branches = [self.run(b.jaxpr, [Trait()] * len(b.consts), given) for b in equation.params["branches"]]
        own = frozenset([Break("lax.cond", which.inputs, True)] if which.inputs else [])
        choose = lambda *results: Trait(union([which, *results]).inputs, union([which, *results]).breaks | own)
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
            wider = [plain(union([old, new])) for old, new in zip(carry, results[:carried], strict=True)]
            if wider == carry:
                return [*carry, *map(plain, results[carried:])]
            carry = wider


def _counts_in_scan(equation, body) -> tuple[int, int]:
    """How much a scan carries, and how many constants come before that. What it goes through row by row has one axis
    more outside than in its body. (JAX has no name for these numbers that all of its versions know.)"""
    whole = lambda outside, inside: sum(a.aval.ndim == b.aval.ndim for a, b in zip(outside, inside, strict=True))
    carried = whole(equation.outvars, body.outvars)
    return carried, whole(equation.invars, body.invars) - carried
