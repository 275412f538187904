"""Equations of a trace replaced by others: what XLA compiles badly on a CPU, by what it compiles well."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, jaxpr_as_fun, jaxprs_in_params

from .reductions import long_reduction, short_reduction
from .scatters import sum_by_scatter

RULES = (sum_by_scatter, short_reduction, long_reduction)
"""Each returns a function to be called in the place of an equation of a trace, or None for an equation that stays."""


def rewritten(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` of PyTrees of arrays, with equations of its trace replaced by the rules."""
    return rewritten_by(_ByRules, function)


def rewritten_by(way: "type[Rewriting]", function: Callable[..., Any]) -> Callable[..., Any]:
    """The same, with equations replaced in another way."""

    def better(*arguments):
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
        results = jaxpr_as_fun(way().of(traced))(*jax.tree.leaves(arguments))
        return jax.tree.unflatten(jax.tree.structure(shapes), results)

    return better


class Rewriting:
    """Replaces equations of a trace and of those inside of it."""

    def __init__(self):
        self.done: dict[int, tuple[Any, Any]] = {}
        """(before, after) by the identity of what was before: an inner trace that comes again stays the same object,
        by which JAX compiles it once. Held here, since an identity is free again once its object is gone."""

    def of(self, traced):
        """The same trace with its equations replaced; what had none of these is returned as it is."""
        inside = getattr(traced, "jaxpr", traced)
        if inside is not traced:  # closed over constants, which JAX keeps in the trace itself from 0.11 on
            inner = self.of(inside)
            return traced if inner is inside else traced.replace(jaxpr=inner)
        if id(traced) not in self.done:
            equations = self.equations(traced)
            same = all(new is old for new, old in zip(equations, traced.eqns, strict=True))
            self.done[id(traced)] = traced, traced if same else traced.replace(eqns=equations)
        return self.done[id(traced)][1]

    def equations(self, trace) -> list[JaxprEqn]:
        """What replaces the equations of a trace, one each."""
        raise NotImplementedError

    def inside(self, equation: JaxprEqn) -> JaxprEqn:
        """The same equation, with equations of the traces that it holds replaced."""
        if not any(True for _ in jaxprs_in_params(equation.params)):
            return equation
        is_jaxpr = lambda leaf: isinstance(leaf, Jaxpr | ClosedJaxpr)
        replace = lambda leaf: self.of(leaf) if is_jaxpr(leaf) else leaf
        parameters = {name: jax.tree.map(replace, value, is_leaf=is_jaxpr) for name, value in equation.params.items()}
        same = all(jax.tree.leaves(jax.tree.map(lambda new, old: new is old, parameters, equation.params)))
        return equation if same else equation.replace(params=parameters)


class _ByRules(Rewriting):
    """Replaces equations one at a time by `RULES`, without a look at their neighbours."""

    def __init__(self):
        super().__init__()
        self.calls: dict[Any, JaxprEqn] = {}
        """What replaces equations that are alike: each is traced once."""

    def equations(self, trace) -> list[JaxprEqn]:
        return [self.of_equation(equation) for equation in trace.eqns]

    def of_equation(self, equation: JaxprEqn) -> JaxprEqn:
        for rule in RULES:
            function = rule(equation)
            if function is not None:
                return self._call(function, equation)
        return self.inside(equation)

    def _call(self, function, equation: JaxprEqn) -> JaxprEqn:
        """The equation that calls `function` in the place of another one, of whose shapes and parameters it is made."""
        alike = equation.primitive, *(variable.aval for variable in equation.invars), *equation.params.items()
        if alike not in self.calls:
            call = calling(function, [variable.aval for variable in equation.invars])
            self.calls[alike] = self.of_equation(call)  # what a rule makes may be replaced too
        return self.calls[alike].replace(invars=equation.invars, outvars=equation.outvars)


def calling(function: Callable[..., Any], kinds: Sequence[Any]) -> JaxprEqn:
    """An equation that calls a function of operands of these types; its variables stand for others."""
    return jax.make_jaxpr(jax.jit(function))(*kinds).eqns[-1]
