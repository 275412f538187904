"""Comparisons in a trace, held as they are in a mode.

Where every outcome of a comparison is an input, the function is smooth; and the differences of what is compared tell
where an outcome changes.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import ClosedJaxpr, JaxprEqn, Literal, Var, jaxpr_as_fun
from jaxtyping import Array, Bool, Float, Int

from ..interval.arithmetic import Interval
from ..interval.enclosure import ranges
from ..interval.repeats import identity, needed_for
from .flat import Flat
from .outcomes import Differences, Outcomes, Which
from .rules import RULES, Pair, compares, lasts, steps
from .surfaces import Step, Surface, chosen, difference, floored, room

EVERYWHERE = 1e8
"""How far from where it is, in its own size and in units, a state is moved to see whether anything moves with it."""


class Comparisons:
    """The comparisons of a function of `moving` PyTrees and others, in which the moving ones play a part.

    The function returns a tuple of PyTrees. What compares integers, or stands in a loop or a branch, is left alone.
    """

    def __init__(self, function: Callable[..., tuple], moving: Sequence[Any], *others: Any):
        given = *moving, *others
        traced, self._shapes = jax.make_jaxpr(function, return_shape=True)(*given)
        self._given = jax.tree.leaves(given)
        self._dtype = jnp.result_type(*jax.tree.leaves(moving))
        self._program = Flat().of(traced)
        self._surfaces: dict[Any, Surface] = {}
        self._steps: dict[int, Step] = {}
        """By the place of their equations."""
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
                locates = compares(equation) and lasts(equation, level)
                if locates:
                    pairs = RULES[equation.primitive.name].pairs
                    self._compared[place] = [self._surface(equation, pair) for pair in pairs]
                elif steps(equation):
                    self._steps[place] = Step(equation.invars[0], room(self._steps), equation.invars[0].aval.shape)
                level += locates or steps(equation)
                levels.update(dict.fromkeys(equation.outvars, level))
        self._depth = max(levels.values(), default=0)

    @property
    def nested(self) -> bool:
        """Whether a comparison is of numbers that the outcome of another one makes."""
        return self._depth > 1

    def outcomes(self, differences: Differences | None = None) -> Outcomes:
        """Those of given differences; without any those that there are."""
        found = differences or self.differences()
        above = (found.surface > 0) | ((found.surface == 0) & self._at_equality())
        return Outcomes(above, jnp.floor(lax.stop_gradient(found.step)))

    def _at_equality(self) -> np.ndarray:
        """The outcomes where both numbers are equal."""
        parts = [np.full(surface.shape, surface.at_equality).ravel() for surface in self._surfaces.values()]
        return np.concatenate([np.zeros(0, bool), *parts])

    def held(self, which: int, outcomes: Outcomes) -> Any:
        """Output number `which` of the function, with these outcomes."""
        before = len(jax.tree.leaves(self._shapes[:which]))
        wanted, tree = jax.tree.flatten(self._shapes[which])
        results = self._program.jaxpr.outvars[before : before + len(wanted)]
        return tree.unflatten(map(jnp.asarray, self._run([], results, outcomes)))

    def differences(self, outcomes: Outcomes | None = None) -> Differences:
        """What is compared, with these outcomes, or with those that there are."""
        asked = [difference(surface) for surface in self._surfaces.values()]
        apart = [equation.outvars[0] for equation in asked]
        found = self._run(asked, [*apart, *(step.of for step in self._steps.values())], outcomes)
        joined = lambda parts: jnp.concatenate([jnp.ravel(x) for x in parts]) if parts else jnp.zeros(0, self._dtype)
        return Differences(joined(found[: len(apart)]), joined(found[len(apart) :]))

    def guards(self, outcomes: Outcomes) -> Float[Array, "guard"]:
        """Guards that fall where an outcome changes."""
        return outcomes.guards(self.differences(outcomes))

    def after(self, guard: Int[Array, ""], outcomes: Outcomes) -> Outcomes:
        """The outcomes after one of these guards fell, or none, and with the mode that there is now: those of numbers
        that stand still are what they are, since nothing would change them. Such is relu(x) > 0 where x < 0, or a
        comparison in a part that the mode leaves out."""
        changed = outcomes.of_guard(guard)
        outcomes = outcomes.passed(guard, self.differences(outcomes))
        if not self.nested and len(self._given) == self._moving:
            return outcomes
        # What stands still follows from outcomes that were settled before.
        settled = lambda _, outcomes: self._looked_at(outcomes, self._stand_still(outcomes), changed)
        return lax.fori_loop(0, self._depth, settled, outcomes)

    def arrived(self, guard: Int[Array, ""], outcomes: Outcomes, rates: Differences) -> Outcomes:
        """The outcomes where what is compared changes at these rates: those of what has come to a rest are what they
        are, unless that guard fell just now."""
        now = self.differences(outcomes)
        at_rest = Which((now.surface == 0) & (rates.surface == 0), rates.step == 0)
        return self._looked_at(outcomes, at_rest, outcomes.of_guard(guard))

    def stopped(self, guard: Int[Array, ""], outcomes: Outcomes, on_zero: Bool[Array, "guard"]) -> Outcomes:
        """The outcomes after some of the guards have come to a rest on zero, on either side by rounding: those of two
        equal numbers, and of a whole one, unless that guard fell just now."""
        return outcomes.stopped(on_zero, self._at_equality(), outcomes.of_guard(guard))

    def _looked_at(self, outcomes: Outcomes, wanted: Which, changed: Which) -> Outcomes:
        """The outcomes, with some of them as they are now, but for those that changed."""
        now = self.outcomes(self.differences(outcomes))
        return outcomes.replaced(now, Which(wanted.surface & ~changed.surface, wanted.step & ~changed.step))

    def _stand_still(self, outcomes: Outcomes) -> Which:
        """Whether what is compared is one number wherever the motion may go with these outcomes."""
        surfaces, floors = list(self._surfaces.values()), list(self._steps.values())
        sides = [side for s in surfaces for side in (s.greater, s.less) if side is not None]
        program, values = self._part([], [*sides, *(step.of for step in floors)], outcomes)
        around = lambda x: Interval(x - EVERYWHERE * (1 + abs(x)), x + EVERYWHERE * (1 + abs(x)))
        found = iter(ranges(program, [*map(around, values[: self._moving]), *values[self._moving :]]))
        still = lambda side, shape: jnp.broadcast_to(side is None or _is_one_number(next(found)), shape).ravel()
        above = [still(s.greater, s.shape) & still(s.less, s.shape) for s in surfaces]
        whole = [still(step.of, step.shape) for step in floors]
        none = jnp.zeros(0, bool)
        return Which(jnp.concatenate([none, *above]), jnp.concatenate([none, *whole]))

    def _surface(self, equation: JaxprEqn, pair: Pair) -> tuple[Surface, bool]:
        """The surface of a pair of operands, a new one unless it has been met; and whether it was met turned round."""
        greater: Any = equation.invars[pair.greater]
        less: Any = None if pair.less is None else equation.invars[pair.less]
        key, wanted = (_key(greater), _key(less)), pair.at_equality
        for turned, known in ((False, key), (True, key[::-1])):
            for at_equality in (False, True) if wanted is None else (wanted != turned,):
                if (known, at_equality) in self._surfaces:
                    return self._surfaces[known, at_equality], turned
        shape = np.broadcast_shapes(greater.aval.shape, () if less is None else less.aval.shape)
        new = Surface(greater, less, bool(wanted), room(self._surfaces), shape)
        self._surfaces[key, bool(wanted)] = new
        return new, False

    def _run(self, more: list[JaxprEqn], results: list[Any], outcomes: Outcomes | None) -> list[Any]:
        """The results of the equations and some more."""
        program, values = self._part(more, results, outcomes)
        return jaxpr_as_fun(program)(*values)

    def _part(self, more: list[JaxprEqn], results: list[Any], outcomes: Outcomes | None):
        """The program of those of the equations and some more that results are made from; and what it is given."""
        jaxpr, values = self._program.jaxpr, self._given
        equations, given = jaxpr.eqns, jaxpr.invars
        if outcomes is not None:
            held, equations = self._with_outcomes
            given, values = [*given, *held], [*values, outcomes.above, outcomes.whole]
        needed, _ = needed_for([*equations, *more], results)
        program = jaxpr.replace(invars=given, eqns=needed, outvars=results)
        return ClosedJaxpr(program, self._program.consts), values

    @functools.cached_property
    def _with_outcomes(self) -> tuple[list[Var], list[JaxprEqn]]:
        """The equations with the outcomes for inputs, and these inputs."""
        kinds = (room(self._surfaces), jnp.dtype(bool)), (room(self._steps), self._dtype)
        held = [Var(jax.core.ShapedArray((size,), dtype)) for size, dtype in kinds]
        return held, [self._with(held, place, equation) for place, equation in enumerate(self._program.jaxpr.eqns)]

    def _with(self, held: list[Var], place: int, equation: JaxprEqn) -> JaxprEqn:
        """An equation, or what stands for it where it compares: a choice by the outcomes."""
        if place in self._steps:
            return floored(self._steps[place], held[1], equation)
        surfaces = self._compared.get(place)
        return equation if surfaces is None else chosen(surfaces, held[0], equation)


def _is_one_number(x: Interval) -> jax.Array:
    """Whether bounds leave no room but that of rounding."""
    return x.high - x.low <= 1e3 * jnp.finfo(x.low.dtype).eps * jnp.maximum(abs(x.low), abs(x.high))


def _key(atom: Any) -> Any:
    """What an operand is known by; every 0 is one."""
    is_zero = atom is None or (isinstance(atom, Literal) and not np.any(np.asarray(atom.val)))
    return 0 if is_zero else identity(atom)
