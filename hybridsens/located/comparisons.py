"""Comparisons in a trace, held as they are in a mode.

A comparison of two numbers, a > b, has one outcome on each side of the surface a - b = 0. So have the choices that are
made of one: abs, max, min, sign and clamp. Where every outcome is an input, the function is smooth; and the differences
a - b tell where an outcome changes.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, JaxprEqn, Literal, Var, jaxpr_as_fun

from ..interval.arithmetic import Interval
from ..interval.breaks import INTERPOLATIONS, JUMPING_CALLS, SMOOTH_CALLS
from ..interval.enclosure import CALLS, inner_jaxpr, ranges
from ..interval.repeats import Distinct, identity, needed_for
from ..xla.rewriting import calling

OPAQUE = SMOOTH_CALLS | JUMPING_CALLS.keys() | set(INTERPOLATIONS)
"""Functions of JAX that are smooth although they compare inside, or whose place is not where one number is another."""


class Rule(NamedTuple):
    """How an operation is made of comparisons."""

    pairs: tuple[tuple[int, int | None], ...]
    """Which operands are compared, (greater, less); None stands for 0."""
    result: Callable[..., Any]
    """The result, given whether each pair is in that order, and the operands."""
    at_equality: bool | None = None
    """Whether a pair counts as in that order where both are equal; None where the result is the same."""


RULES = {
    "gt": Rule(((0, 1),), lambda above, a, b: above, False),
    "ge": Rule(((0, 1),), lambda above, a, b: above, True),
    "lt": Rule(((1, 0),), lambda above, a, b: above, False),
    "le": Rule(((1, 0),), lambda above, a, b: above, True),
    "max": Rule(((0, 1),), lambda above, a, b: jnp.where(above, a, b)),
    "min": Rule(((0, 1),), lambda above, a, b: jnp.where(above, b, a)),
    "abs": Rule(((0, None),), lambda above, a: jnp.where(above, a, -a)),
    "sign": Rule(((0, None),), lambda above, a: jnp.where(above, jnp.ones_like(a), -jnp.ones_like(a))),
    "clamp": Rule(
        ((1, 0), (2, 1)), lambda above, below, low, x, high: jnp.where(above, jnp.where(below, x, high), low)
    ),
}
"""What a sign is at 0, which is a single instant, is that of one side."""

EVERYWHERE = 1e8
"""How far from where it is, in its own size and in units, a state is moved to see whether anything moves with it."""


class Surface(NamedTuple):
    """Where an outcome changes."""

    greater: Any
    less: Any | None
    at_equality: bool
    """The outcome where both are equal."""
    start: int
    """Where its outcomes stand among all."""
    shape: tuple[int, ...]

    def of(self, outcomes: jax.Array) -> jax.Array:
        """Its outcomes, in its shape."""
        return outcomes[self.start : self.start + math.prod(self.shape)].reshape(self.shape)


class Comparisons:
    """The comparisons of a function of `moving` PyTrees and others, in which the moving ones play a part.

    The function returns a tuple of PyTrees. What compares integers, or stands in a loop or a branch, is left alone.
    """

    def __init__(self, function: Callable[..., tuple], moving: Sequence[Any], *others: Any):
        given = *moving, *others
        traced, self._shapes = jax.make_jaxpr(function, return_shape=True)(*given)
        self._given = jax.tree.leaves(given)
        self._program = _Flat().of(traced)
        self._surfaces: dict[Any, Surface] = {}
        self.count = 0
        """How many outcomes there are."""
        self._moving = len(jax.tree.leaves(moving))
        moved: set[Var] = set(self._program.jaxpr.invars[: self._moving])
        levels: dict[Var, int] = {}
        """Of comparisons, one made from the outcome of another, that a variable is made from."""
        self._compared: dict[int, list[tuple[Surface, bool]]] = {}
        """The surfaces of an equation, by its place, and whether each is asked for the other way round."""
        for place, equation in enumerate(self._program.jaxpr.eqns):
            operands = [a for a in equation.invars if not isinstance(a, Literal)]
            if moved.intersection(operands):
                moved.update(equation.outvars)
                level = max(levels.get(operand, 0) for operand in operands)
                if _compares(equation):
                    self._compared[place] = [self._surface(equation, pair) for pair in _rule(equation).pairs]
                    level += 1
                levels.update(dict.fromkeys(equation.outvars, level))
        self._depth = max(levels.values(), default=0)

    def held(self, which: int, above: jax.Array) -> Any:
        """Output number `which` of the function, with these outcomes."""
        before = len(jax.tree.leaves(self._shapes[:which]))
        wanted, tree = jax.tree.flatten(self._shapes[which])
        results = self._program.jaxpr.outvars[before : before + len(wanted)]
        return tree.unflatten(map(jnp.asarray, self._run([], results, above)))

    def differences(self, above: jax.Array | None = None) -> jax.Array:
        """What is compared, greater - less, of shape (count,): with these outcomes, or with those that they have."""
        asked = [_difference(surface) for surface in self._surfaces.values()]
        found = self._run(asked, [equation.outvars[0] for equation in asked], above)
        return jnp.concatenate([jnp.ravel(x) for x in found]) if found else jnp.zeros(0)

    def outcomes(self, differences: jax.Array) -> jax.Array:
        """Whether greater counts as above less, for these differences."""
        parts = [np.full(surface.shape, surface.at_equality).ravel() for surface in self._surfaces.values()]
        at_equality = np.concatenate([np.zeros(0, bool), *parts])
        return (differences > 0) | ((differences == 0) & at_equality)

    def settled(self, above: jax.Array, changed: jax.Array) -> jax.Array:
        """The outcomes after some have `changed`, or the mode has: those of numbers that stand still now are what they
        are, since nothing would change them. Such is relu(x) > 0 where x < 0, or a comparison in a part that the mode
        leaves out."""
        if self._depth < 2 and len(self._given) == self._moving:
            return above
        for _ in range(self._depth):  # what stands still follows from outcomes that were settled before
            now = self.outcomes(self.differences(above))
            above = jnp.where(self._stands_still(above) & ~changed, now, above)
        return above

    def _stands_still(self, above: jax.Array) -> jax.Array:
        """Whether both that are compared are the same number wherever the motion may go with these outcomes."""
        sides = [atom for surface in self._surfaces.values() for atom in (surface.greater, surface.less)]
        program, values = self._part([], [atom for atom in sides if atom is not None], above)
        around = lambda x: Interval(x - EVERYWHERE * (1 + abs(x)), x + EVERYWHERE * (1 + abs(x)))
        found = iter(ranges(program, [*map(around, values[: self._moving]), *values[self._moving :]]))
        one_number = lambda x: x.high - x.low <= 1e3 * jnp.finfo(x.low.dtype).eps * jnp.maximum(abs(x.low), abs(x.high))
        still = lambda atom, shape: jnp.broadcast_to(True if atom is None else one_number(next(found)), shape)
        both = [still(s.greater, s.shape) & still(s.less, s.shape) for s in self._surfaces.values()]
        return jnp.concatenate([jnp.ravel(x) for x in both])

    def _surface(self, equation: JaxprEqn, pair: tuple[int, int | None]) -> tuple[Surface, bool]:
        """The surface of a pair of operands, a new one unless it has been met; and whether it was met turned round."""
        greater: Any = equation.invars[pair[0]]
        less: Any = None if pair[1] is None else equation.invars[pair[1]]
        key, wanted = (_key(greater), _key(less)), _rule(equation).at_equality
        for turned, known in ((False, key), (True, key[::-1])):
            for at_equality in (False, True) if wanted is None else (wanted != turned,):
                if (known, at_equality) in self._surfaces:
                    return self._surfaces[known, at_equality], turned
        shape = np.broadcast_shapes(greater.aval.shape, () if less is None else less.aval.shape)
        new = self._surfaces[key, bool(wanted)] = Surface(greater, less, bool(wanted), self.count, shape)
        self.count += math.prod(shape)
        return new, False

    def _run(self, more: list[JaxprEqn], results: list[Any], above: jax.Array | None) -> list[Any]:
        """The results of the equations and some more."""
        program, values = self._part(more, results, above)
        return jaxpr_as_fun(program)(*values)

    def _part(self, more: list[JaxprEqn], results: list[Any], above: jax.Array | None) -> tuple[ClosedJaxpr, list[Any]]:
        """The program of those of the equations and some more that results are made from; and what it is given."""
        jaxpr, values = self._program.jaxpr, self._given
        equations, given = jaxpr.eqns, jaxpr.invars
        if above is not None:
            outcomes = Var(jax.core.ShapedArray(above.shape, above.dtype))
            given, values = [*given, outcomes], [*values, above]
            equations = [self._with(outcomes, place, equation) for place, equation in enumerate(equations)]
        needed, _ = needed_for([*equations, *more], results)
        program = jaxpr.replace(invars=given, eqns=needed, outvars=results)
        return ClosedJaxpr(program, self._program.consts), values

    def _with(self, outcomes: Var, place: int, equation: JaxprEqn) -> JaxprEqn:
        """An equation, or what stands for it where it compares: a choice by the outcomes."""
        surfaces = self._compared.get(place)
        if surfaces is None:
            return equation
        kind: Any = equation.outvars[0].aval

        def result(above, *operands):
            rows = [surface.of(above) ^ turned for surface, turned in surfaces]
            return _rule(equation).result(*rows, *operands).astype(kind.dtype)

        return calling(result, [outcomes, *equation.invars], equation.outvars)


class _Flat(Distinct):
    """The equations of a trace, and of those calls that compare inside, each once."""

    def goes_inside(self, equation: JaxprEqn) -> bool:
        return equation.primitive.name in CALLS and _compares_inside(equation)


def _compares_inside(equation: JaxprEqn) -> bool:
    """Whether a call compares real numbers, by itself or in another call inside."""
    jaxpr, _ = inner_jaxpr(equation)
    if (equation.params.get("name") or getattr(jaxpr.debug_info, "func_name", "")) in OPAQUE:
        return False
    is_call = lambda inner: inner.primitive.name in CALLS
    return any(_compares(inner) or (is_call(inner) and _compares_inside(inner)) for inner in jaxpr.eqns)


def _rule(equation: JaxprEqn) -> Rule:
    return RULES[equation.primitive.name]


def _compares(equation: JaxprEqn) -> bool:
    """Whether an equation compares real numbers."""
    is_real = lambda atom: np.issubdtype(atom.aval.dtype, np.floating)
    return equation.primitive.name in RULES and all(map(is_real, equation.invars))


def _key(atom: Any) -> Any:
    """What an operand is known by; every 0 is one."""
    is_zero = atom is None or (isinstance(atom, Literal) and not np.any(np.asarray(atom.val)))
    return 0 if is_zero else identity(atom)


def _difference(surface: Surface) -> JaxprEqn:
    """The equation that tells on which side of a surface one is, and how far."""
    given = [surface.greater, *([] if surface.less is None else [surface.less])]
    difference = Var(jax.core.ShapedArray(surface.shape, surface.greater.aval.dtype))
    return calling(lambda greater, less=0.0: greater - less, given, [difference])
