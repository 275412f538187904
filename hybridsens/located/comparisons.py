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

from ..interval.breaks import INTERPOLATIONS, JUMPING_CALLS, SMOOTH_CALLS
from ..interval.enclosure import CALLS, inner_jaxpr
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


GREATER = Rule(((0, 1),), lambda above, a, b: above)
LESS = Rule(((1, 0),), lambda above, a, b: above)
RULES = {
    "gt": GREATER,
    "ge": GREATER,
    "lt": LESS,
    "le": LESS,
    "max": Rule(((0, 1),), lambda above, a, b: jnp.where(above, a, b)),
    "min": Rule(((0, 1),), lambda above, a, b: jnp.where(above, b, a)),
    "abs": Rule(((0, None),), lambda above, a: jnp.where(above, a, -a)),
    "sign": Rule(((0, None),), lambda above, a: jnp.where(above, jnp.ones_like(a), -jnp.ones_like(a))),
    "clamp": Rule(
        ((1, 0), (2, 1)), lambda above, below, low, x, high: jnp.where(above, jnp.where(below, x, high), low)
    ),
}
"""At equality, which is a single instant, the outcome is that of one side."""


class Surface(NamedTuple):
    """Where an outcome changes."""

    greater: Any
    less: Any | None
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
        moved: set[Var] = set(self._program.jaxpr.invars[: len(jax.tree.leaves(moving))])
        self._compared: dict[int, list[tuple[Surface, bool]]] = {}
        """The surfaces of an equation, by its place, and whether each is asked for the other way round."""
        for place, equation in enumerate(self._program.jaxpr.eqns):
            if moved.intersection(a for a in equation.invars if not isinstance(a, Literal)):
                moved.update(equation.outvars)
                if _compares(equation):
                    self._compared[place] = [self._surface(equation, pair) for pair in _rule(equation).pairs]

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

    def _surface(self, equation: JaxprEqn, pair: tuple[int, int | None]) -> tuple[Surface, bool]:
        """The surface of a pair of operands, a new one unless it has been met; and whether it was met turned round."""
        greater: Any = equation.invars[pair[0]]
        less: Any = None if pair[1] is None else equation.invars[pair[1]]
        key = _key(greater), _key(less)
        for turned, known in ((False, key), (True, key[::-1])):
            if known in self._surfaces:
                return self._surfaces[known], turned
        shape = np.broadcast_shapes(greater.aval.shape, () if less is None else less.aval.shape)
        self._surfaces[key] = Surface(greater, less, self.count, shape)
        self.count += math.prod(shape)
        return self._surfaces[key], False

    def _run(self, more: list[JaxprEqn], results: list[Any], above: jax.Array | None) -> list[Any]:
        """The results of the equations and some more, of which only those that are needed are run."""
        jaxpr, values = self._program.jaxpr, self._given
        equations, given = jaxpr.eqns, jaxpr.invars
        if above is not None:
            outcomes = Var(jax.core.ShapedArray(above.shape, above.dtype))
            given, values = [*given, outcomes], [*values, above]
            equations = [self._with(outcomes, place, equation) for place, equation in enumerate(equations)]
        needed, _ = needed_for([*equations, *more], results)
        program = jaxpr.replace(invars=given, eqns=needed, outvars=results)
        return jaxpr_as_fun(ClosedJaxpr(program, self._program.consts))(*values)

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
