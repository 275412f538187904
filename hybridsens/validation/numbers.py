"""Numbers in the fields of a scene or a system: those of an array's field become arrays, others are told of.

`eqx.filter_grad` differentiates by arrays of real numbers, and gives None for every other leaf, without a word. So

- a Python number, a list of them or a real array of NumPy, in a field that is declared as an array, becomes a real
  array of JAX: the declaration says what is meant, and an array of NumPy cannot be indexed by a number of an event;
- one in a field that is declared otherwise (`length: float`) stays as it is. Equinox takes it for a constant, which
  may be asked about by `if`, and a checker of annotations would refuse an array there. The same goes for an array of
  integers, which may be indices. Where a derivative by the other leaves is taken, a warning names them; and at once
  where there are no others, for a derivative by none leaves no trace.
"""

import dataclasses
import decimal
import functools
import numbers
import re
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .caller import warn_caller

_ARRAY = re.compile(r"\bArray(Like)?\b")
_CONTAINER = re.compile(r"\b([Ll]ist|[Tt]uple|[Dd]ict|Sequence|Iterable|Mapping|PyTree)\b")
_MAY_BE_NONE = re.compile(r"\b(None|Optional|Any|PyTree)\b")
_OF_INTEGERS = re.compile(r"\b(U?Int\d*|Integer|Bool|Key|PRNGKeyArray|Shaped)\b")


def numbers_to_arrays(module: Any) -> None:
    """Put real arrays in the place of numbers in fields that are declared as arrays; called while `module` is made.

    Raises: TypeError for a list that is none of numbers, for text, and for nothing at all."""
    for field in dataclasses.fields(module):
        value, declared = getattr(module, field.name, None), str(field.type)
        number = isinstance(value, numbers.Real | decimal.Decimal) and not isinstance(value, bool)
        listed = isinstance(value, list | tuple) and not _CONTAINER.search(declared)
        of_numpy = isinstance(value, np.ndarray) and value.dtype.kind == "f"
        missing = isinstance(value, str) or (value is None and not _MAY_BE_NONE.search(declared))
        if (number or listed or of_numpy or missing) and _ARRAY.search(declared) and not _OF_INTEGERS.search(declared):
            object.__setattr__(module, field.name, _as_array(module, field.name, value))  # Equinox freezes what is made


def _as_array(module: Any, name: str, value: Any) -> jax.Array:
    refusal = TypeError(
        f"`{name}` of {type(module).__name__} is declared as an array and must hold real numbers, but is {value!r}."
    )
    if value is None or isinstance(value, str):  # NumPy would make numbers of them
        raise refusal
    try:
        return jnp.array(value, value.dtype if isinstance(value, np.ndarray) else float)  # float32 is meant
    except (TypeError, ValueError) as error:
        raise refusal from error


def told_of_constants(module: Any) -> Any:
    """The module, of which a warning tells what is no parameter, if a derivative by the others is taken."""
    constants = _constants(module)
    if not constants:
        return module
    message = (
        f"A parameter must be an array of real numbers, but {type(module).__name__} has Python numbers or integers in "
        f"{', '.join(constants)}, which no gradient is taken by (`eqx.filter_grad` has None there). Declare the field "
        "as jax.Array and give it 1.0 or jnp.array(1.0); or, for a constant, write eqx.field(static=True)."
    )
    parameters, rest = eqx.partition(module, eqx.is_inexact_array)
    if not jax.tree.leaves(parameters):
        warn_caller(message)
    # The parameters alone pass through: what is a number or a function here stays what it is.
    return eqx.combine(_told(message, parameters), rest)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _told(message: str, parameters: Any) -> Any:
    return parameters


@_told.defjvp
def _told_jvp(message: str, primals, tangents):
    warn_caller(message)
    return primals[0], tangents[0]


def _constants(module: Any) -> list[str]:
    """Names of the leaves that look like parameters and are none: Python floats, and signed integers in arrays."""
    name = lambda path: jax.tree_util.keystr(path, simple=True, separator=".")
    declared = {field.name: str(field.type) for field in dataclasses.fields(module)}
    meant = {name for name, text in declared.items() if _OF_INTEGERS.search(text)}
    leaves = jax.tree_util.tree_leaves_with_path(module)
    return [name(path) for path, leaf in leaves if _is_constant(leaf) and name(path[:1]) not in meant]


def _is_constant(leaf: Any) -> bool:
    if isinstance(leaf, jax.Array | np.ndarray):
        return jnp.issubdtype(leaf.dtype, jnp.signedinteger)
    return isinstance(leaf, float)
