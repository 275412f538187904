"""What a trace says twice, said once.

XLA finds repeats in the end. But before it does, each was differentiated, bounded and handed on by itself.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, Literal, Var, jaxpr_as_fun

from .calls import inner_jaxpr, walked
from .tables import is_interpolation

WORTH, SHORT = 0.75, 32
"""A trace that keeps more than that part of its equations is left as it is, or one that has no more than so many."""


def without_repeats(function: Callable[..., Any], *arguments) -> Callable[..., Any] | None:
    """`function` of PyTrees of arrays like these, traced once and without what the trace says twice or does not need;
    None where that is little or leaves nearly all of it."""
    traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
    distinct = Distinct()
    program = distinct.of(traced)
    if distinct.met <= SHORT or len(program.eqns) > WORTH * distinct.met:
        return None
    run, tree = jaxpr_as_fun(program), jax.tree.structure(shapes)
    return lambda *given: tree.unflatten(map(jnp.asarray, run(*jax.tree.leaves(given))))  # constants are NumPy's


class Distinct:
    """The equations of a trace, and of the programs that it calls, each once."""

    def __init__(self):
        self.equations: list[JaxprEqn] = []
        self.constants: dict[Var, Any] = {}
        self.known: dict[Any, list[Var]] = {}
        """Results, by what is done and to what."""
        self.met = 0
        """How many equations there were."""

    def of(self, traced: ClosedJaxpr) -> ClosedJaxpr:
        """The same program."""
        results = self._run(traced.jaxpr, [*self._constants(traced), *traced.jaxpr.invars])
        equations, needed = needed_for(self.equations, results)
        constants = {variable: value for variable, value in self.constants.items() if variable in needed}
        program = traced.jaxpr.replace(constvars=list(constants), eqns=equations, outvars=results)
        return ClosedJaxpr(program, list(constants.values()))

    def _run(self, jaxpr: Jaxpr, given: list[Any]) -> list[Any]:
        """What stands for the results of a program, of its constants and arguments."""
        way = lambda equation: self._call if self.goes_inside(equation) else self._once
        return walked(jaxpr, given, lambda atom: atom, lambda equation, operands: way(equation)(equation, operands))

    def goes_inside(self, equation: JaxprEqn) -> bool:
        """Whether an equation is replaced by those of the program that it calls."""
        return equation.primitive.name == "jit" and not is_interpolation(equation)  # whose bounds are of a whole

    def _call(self, equation: JaxprEqn, operands: list[Any]) -> list[Any]:
        jaxpr, constants = inner_jaxpr(equation)
        return self._run(jaxpr, [*self._constants(ClosedJaxpr(jaxpr, constants)), *operands])

    def _constants(self, program: ClosedJaxpr) -> list[Var]:
        """What stands for a program's constants: they become those of the whole."""
        own = [Var(variable.aval) for variable in program.jaxpr.constvars]
        self.constants.update(zip(own, program.consts, strict=True))
        return own

    def _once(self, equation: JaxprEqn, operands: list[Any]) -> list[Var]:
        self.met += 1
        what = equation.primitive, tuple(map(identity, operands)), tuple(sorted(equation.params.items()))
        if equation.effects or not _hashable(what):  # what has an effect is done as often as it is said
            return self._kept(equation, operands)
        if what not in self.known:
            self.known[what] = self._kept(equation, operands)
        return self.known[what]

    def _kept(self, equation: JaxprEqn, operands: list[Any]) -> list[Var]:
        results = [Var(variable.aval) for variable in equation.outvars]
        self.equations.append(equation.replace(invars=operands, outvars=results))
        return results


def identity(atom: Any) -> Any:
    """What an operand is known by; a number by its bits and its type."""
    return (np.asarray(atom.val).tobytes(), atom.aval) if isinstance(atom, Literal) else atom


def _hashable(what: Any) -> bool:
    try:
        hash(what)
    except TypeError:
        return False
    return True


def needed_for(equations: list[JaxprEqn], results: list[Any]) -> tuple[list[JaxprEqn], set[Var]]:
    """The equations that the results are made from, and all variables that are read."""
    variables = lambda atoms: {atom for atom in atoms if not isinstance(atom, Literal)}
    needed, kept = variables(results), []
    for equation in reversed(equations):
        if equation.effects or needed.intersection(equation.outvars):
            kept.append(equation)
            needed |= variables(equation.invars)
    return kept[::-1], needed
