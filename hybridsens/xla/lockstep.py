"""Batches whose elements run in step, as on a GPU: a row of a record is selected before it is written.

A loop of a batch goes on until its last element is done. What a turn does to elements that were done before must not
count, so Equinox selects between all that the turn gives and all that there was. Most of what a motion carries is the
record of its steps, of which a turn writes one row: a turn would copy all of it. Here it costs the same, however long
the record is.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import JaxprEqn

from .rewriting import Rewriting, calling, rewritten_by


def lockstep(function: Callable[..., Any], axes: Any) -> Callable[..., Any]:
    """`jax.vmap(function, axes)`, for a function of PyTrees of arrays."""
    return jax.vmap(rewritten_by(_RowsSelected, function), axes)


class _RowsSelected(Rewriting):
    """Replaces selections between a record with one row more and the record."""

    def equations(self, trace) -> list[JaxprEqn]:
        made_by = {id(variable): equation for equation in trace.eqns for variable in equation.outvars}
        return [self.inside(_joined(equation, made_by)) for equation in trace.eqns]


def _joined(equation: JaxprEqn, made_by: dict[int, JaxprEqn]) -> JaxprEqn:
    """One equation in the place of a selection and the writing of a row; any other as it is."""
    if equation.primitive.name != "select_if_vmap":
        return equation
    goes_on, after, before = (_source(variable, made_by) for variable in equation.invars)
    write = made_by.get(id(after))
    if write is None or write.primitive is not lax.dynamic_update_slice_p:
        return equation
    record = _source(write.invars[0], made_by)
    if record is not before:
        return equation
    operands = [goes_on, record, *write.invars[1:]]
    call = calling(_write_where, [operand.aval for operand in operands])
    return call.replace(invars=operands, outvars=equation.outvars)


def _source(variable, made_by: dict[int, JaxprEqn]):
    """What a variable is a copy of."""
    while (equation := made_by.get(id(variable))) is not None and equation.primitive.name == "copy":
        (variable,) = equation.invars
    return variable


def _write_where(goes_on, record, row, *place):
    """The record with the row in its place where the element goes on, and as it was elsewhere."""
    row = jnp.where(goes_on, row, lax.dynamic_slice(record, place, row.shape))
    return lax.dynamic_update_slice(record, row, place)
