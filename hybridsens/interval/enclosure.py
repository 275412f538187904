"""The range of a traced function along a path: its primitives one by one, each in interval arithmetic."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import lax

from . import jet as J
from .calls import CALLS, inner_jaxpr, walked
from .jet import Jet, Truth
from .primitives import (
    BINARY,
    COMPARISONS,
    LINEAR_SHAPES,
    LOGIC,
    PLACED,
    UNARY,
    dot_general,
    select,
    select_condition,
)
from .products import FEW, PRODUCTS, Once, at_once, count_products, product_once
from .tables import interpolated, is_interpolation


def enclose(closed_jaxpr, arguments: Sequence[Jet], once: Once = at_once) -> Jet:
    """Range of a function of one result, and of its first two derivatives, over an interval of s on which those of its
    arguments are known. Entries made by an operation without a rule are unknown (not a number)."""
    once = once if count_products(closed_jaxpr.jaxpr) > FEW else at_once
    (out,) = _run(closed_jaxpr.jaxpr, closed_jaxpr.consts, arguments, once)
    return _jet(out)


def ranges(closed_jaxpr, arguments: Sequence[Any]) -> list[J.Interval]:
    """Range of each result of a function, from those of the arguments that are given as intervals."""
    nothing = lambda x: J.point(jnp.full_like(x.low, jnp.nan))
    jets = [Jet(x, nothing(x), nothing(x)) if isinstance(x, J.Interval) else x for x in arguments]
    return [_jet(out).value for out in _run(closed_jaxpr.jaxpr, closed_jaxpr.consts, jets, at_once)]


def _run(jaxpr, constants, arguments, once: Once) -> list[Any]:
    return walked(jaxpr, (*constants, *arguments), lambda atom: atom.val, functools.partial(_evaluate, once))


def _evaluate(once: Once, equation, operands: list[Any]) -> list[Any]:
    """Results of one equation: arrays where nothing that it reads moves, else jets or conditions."""
    name, params = equation.primitive.name, equation.params
    if name in CALLS:
        if isinstance(operands[0], Jet) and _reads_a_table(equation, operands):
            return [interpolated(*operands)]
        return _run(*inner_jaxpr(equation), operands, once)
    if name == "cond" and not isinstance(operands[0], Jet | Truth):
        cases = [_run(branch.jaxpr, branch.consts, operands[1:], once) for branch in params["branches"]]
        return [_picked(operands[0], results) for results in zip(*cases, strict=True)]
    bind = lambda *values: equation.primitive.bind(*values, **params)
    if not any(isinstance(operand, Jet | Truth) for operand in operands):
        outcome = bind(*operands)
        return list(outcome) if equation.primitive.multiple_results else [outcome]
    if name == "unstack":  # x, y = q
        return [_entry(operands[0], k, params["axis"]) for k in range(len(equation.outvars))]
    if name == "split":  # in derivatives of `jnp.concatenate`
        return _pieces(operands[0], params["sizes"], params["axis"])
    rule = lambda: _rule(name, params, operands, bind)
    outcome = product_once(rule, once) if name in PRODUCTS and all(isinstance(x, Jet) for x in operands) else rule()
    if outcome is None:
        return [_unknown(variable.aval) for variable in equation.outvars]
    return [_spread(outcome, equation.outvars[0].aval.shape)]


def _reads_a_table(equation, operands) -> bool:
    """Whether it interpolates in a table of numbers that stand still."""
    return not any(isinstance(x, Jet | Truth) for x in operands[1:]) and is_interpolation(equation)


def _entry(x: Jet | Truth, k: int, axis: int) -> Jet | Truth:
    """One entry along an axis."""
    return _taken(x, lambda part: lax.index_in_dim(part, k, axis, keepdims=False))


def _pieces(x: Jet | Truth, sizes, axis: int) -> list[Jet | Truth]:
    """Pieces of these sizes along an axis."""
    ends = np.cumsum(sizes).tolist()
    cut = lambda size, end: lambda part: lax.slice_in_dim(part, end - size, end, axis=axis)
    return [_taken(x, cut(size, end)) for size, end in zip(sizes, ends, strict=True)]


def _taken(x: Jet | Truth, take: Callable) -> Jet | Truth:
    return Truth(*map(take, x)) if isinstance(x, Truth) else J.linear(take, x)


def _picked(which, cases) -> Any:
    """The result of the branch that a constant picks: an array where no branch moves, else a jet or a condition."""
    return _selected(which, cases) if any(isinstance(x, Jet | Truth) for x in cases) else lax.select_n(which, *cases)


def _selected(which, cases) -> Jet | Truth | None:
    """`lax.select_n` of numbers or of conditions; None where it goes by a number that moves."""
    if isinstance(which, Jet):
        return None
    if any(_is_condition(case) for case in cases):
        return select_condition(which, [_truth(case) for case in cases])
    return select(which, [_jet(case) for case in cases])


def _rule(name: str, params, operands: list[Any], bind: Callable) -> Jet | Truth | None:
    """Result of an operation on operands of which some move; None where no rule is known."""
    if name in LOGIC:
        return LOGIC[name](*map(_truth, operands))
    if name == "select_n":
        return _selected(operands[0], operands[1:])
    if name == "convert_element_type":
        return _converted(operands[0], params["new_dtype"])
    if name in PLACED:
        return _placed(PLACED[name], operands, bind)
    if any(isinstance(x, Truth) for x in operands):
        return _of_conditions(name, operands, bind)
    if name == "integer_pow":
        return J.integer_power(operands[0], params["y"])
    if name == "clamp":
        low, x, high = (_jet(x) for x in operands)
        return J.minimum(J.maximum(x, low), high)
    if name == "dot_general":
        return dot_general(_jet(operands[0]), _same_or_jet(operands), params)
    if name in UNARY:
        return UNARY[name](operands[0])
    if name in BINARY:
        return BINARY[name](_jet(operands[0]), _same_or_jet(operands))
    if name in LINEAR_SHAPES:
        return _moved([_jet(x) for x in operands], bind)
    return None


def _placed(entries: tuple[int, ...], operands, bind) -> Jet | Truth | None:
    """Entries read from places or put there, of numbers or of conditions: the operands of these indices. The others
    tell the places; None where these move."""
    if any(isinstance(x, Jet | Truth) for k, x in enumerate(operands) if k not in entries):
        return None

    def at_places(*parts):
        filled = list(operands)
        for k, part in zip(entries, parts, strict=True):
            filled[k] = part
        return bind(*filled)

    given = [operands[k] for k in entries]
    if all(map(_is_condition, given)):
        return Truth(*(at_places(*parts) for parts in zip(*map(_truth, given), strict=True)))
    return _moved([_jet(x) for x in given], at_places)


def _of_conditions(name: str, operands, bind) -> Truth | None:
    """What moves conditions, several of them to one place too (`jnp.stack`), or compares them."""
    if not all(_is_condition(x) for x in operands):
        return None
    truths = [_truth(x) for x in operands]
    if name in LINEAR_SHAPES:
        return Truth(*(bind(*parts) for parts in zip(*truths, strict=True)))
    return COMPARISONS[name](*truths) if name in COMPARISONS else None


def _is_condition(x) -> bool:
    return isinstance(x, Truth) or (not isinstance(x, Jet) and jnp.issubdtype(jnp.result_type(x), jnp.bool_))


def _truth(x) -> Truth:
    return x if isinstance(x, Truth) else Truth(jnp.asarray(x), jnp.asarray(x))


def _spread(outcome: Jet | Truth, shape):
    """Every part in the shape of the result: an operand that is one number for all entries may have made it."""
    spread = lambda x: x if x.shape == shape else jnp.broadcast_to(x, shape)
    return Truth(*map(spread, outcome)) if isinstance(outcome, Truth) else J.linear(spread, outcome)


def _jet(x) -> Jet:
    return x if isinstance(x, Jet) else J.constant(jnp.asarray(x))


def _same_or_jet(operands) -> Jet:
    """The second operand: the same object as the first where both are one variable, since x x is never negative."""
    return operands[0] if operands[1] is operands[0] else _jet(operands[1])


def _converted(x, dtype):
    if jnp.issubdtype(dtype, jnp.bool_):
        return x if isinstance(x, Truth) else None
    if not jnp.issubdtype(dtype, jnp.floating):
        return None
    if isinstance(x, Truth):
        low, high = (y.astype(dtype) for y in x)
        rate = J.point(jnp.where(low == high, 0.0, jnp.nan).astype(dtype))
        return Jet(J.Interval(low, high), rate, rate)
    return J.linear(lambda y: y.astype(dtype), x)


def _moved(jets: list[Jet], bind) -> Jet:
    """A linear operation on several jets at once, without negative weights: they are laid side by side, say."""
    parts = []
    for all_parts in zip(*jets, strict=True):
        if all(part is None for part in all_parts):
            parts.append(None)
            continue
        filled = [part or J.point(jnp.zeros_like(jet.value.low)) for part, jet in zip(all_parts, jets, strict=True)]
        exact = all(part.exact for part in filled)
        low = bind(*(part.low for part in filled))
        parts.append(J.Interval(low, low if exact else bind(*(part.high for part in filled))))
    return Jet(*parts)


def _unknown(aval) -> Jet | Truth:
    """What may be anything: nan bounds, or a condition that is possible and not sure."""
    if aval.dtype == bool:
        return Truth(jnp.zeros(aval.shape, bool), jnp.ones(aval.shape, bool))
    dtype = aval.dtype if jnp.issubdtype(aval.dtype, jnp.floating) else jnp.result_type(float)
    nothing = J.point(jnp.full(aval.shape, jnp.nan, dtype))
    return Jet(nothing, nothing, nothing)
