"""Scatters as loops: XLA makes no kernel of a loop with a scatter in it, and would interpret the whole motion instead.

A force that reads q[indices] is differentiated by a scatter, one that adds up by x.at[indices].add(...) is one itself.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, jaxpr_as_fun, jaxprs_in_params

MOST = 2**24
"""Entries of an array that are added to, up to which single precision counts them exactly; a larger one stays."""


def without_scatters(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` of PyTrees of arrays, in whose trace every sum by a scatter is one by a loop."""

    def looped(*arguments):
        traced, shapes = jax.make_jaxpr(function, return_shape=True)(*arguments)
        results = jaxpr_as_fun(_rewritten(traced, {}))(*jax.tree.leaves(arguments))
        return jax.tree.unflatten(jax.tree.structure(shapes), results)

    return looped


def _rewritten(traced, done: dict[int, Any]):
    """The same jaxpr with its scatters replaced, those of inner ones too; what had none is returned as it is.

    `done` keeps an inner jaxpr that comes again the same object, by which JAX compiles it once."""
    if isinstance(traced, ClosedJaxpr):
        inner = _rewritten(traced.jaxpr, done)
        return traced if inner is traced.jaxpr else traced.replace(jaxpr=inner)
    if id(traced) not in done:
        equations = [_rewritten_equation(equation, done) for equation in traced.eqns]
        same = all(new is old for new, old in zip(equations, traced.eqns, strict=True))
        done[id(traced)] = traced if same else traced.replace(eqns=equations)
    return done[id(traced)]


def _rewritten_equation(equation: JaxprEqn, done: dict[int, Any]) -> JaxprEqn:
    if equation.primitive is lax.scatter_add_p:
        total: Any = equation.outvars[0].aval
        return _as_loop(equation) if total.size < MOST else equation
    if not any(True for _ in jaxprs_in_params(equation.params)):
        return equation
    is_jaxpr = lambda leaf: isinstance(leaf, Jaxpr | ClosedJaxpr)
    replace = lambda leaf: _rewritten(leaf, done) if is_jaxpr(leaf) else leaf
    parameters = {name: jax.tree.map(replace, value, is_leaf=is_jaxpr) for name, value in equation.params.items()}
    same = all(jax.tree.leaves(jax.tree.map(lambda new, old: new is old, parameters, equation.params)))
    return equation if same else equation.replace(params=parameters)


def _as_loop(equation: JaxprEqn) -> JaxprEqn:
    """An equation that calls `_add_one_by_one` for a scatter."""
    add = jax.jit(partial(_add_one_by_one, equation.params))
    shapes: list[Any] = [variable.aval for variable in equation.invars]
    call = jax.make_jaxpr(add)(*shapes).eqns[-1]
    return call.replace(invars=equation.invars, outvars=equation.outvars)


def _add_one_by_one(parameters: dict[str, Any], operand, indices, updates):
    """operand[indices] += updates, one entry after another."""
    scatter = lambda numbers: lax.scatter_add_p.bind(jnp.zeros(operand.shape), indices, numbers, **parameters)
    # Where an update goes is what a scatter's transpose reads there; it reads 0 where an update is dropped.
    places = 1 + jnp.arange(operand.size, dtype=float).reshape(operand.shape)
    (places,) = jax.linear_transpose(scatter, jax.ShapeDtypeStruct(updates.shape, places.dtype))(places)
    places, updates = places.ravel().astype(int), updates.ravel()

    def add(k, total):
        known = lax.dynamic_slice(total, (places[k],), (1,))
        return lax.dynamic_update_slice(total, known + updates[k], (places[k],))

    dropped = jnp.zeros(1, operand.dtype)
    total = lax.fori_loop(0, updates.size, add, jnp.concatenate([dropped, operand.ravel()]))
    return total[1:].reshape(operand.shape)
