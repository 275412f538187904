"""What a scene's functions return, seen before anything runs: named where it is no array of real numbers."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np


def returned_array(name: str, function: Callable, *arguments) -> jax.ShapeDtypeStruct:
    """Shape and type of the one array that a function returns.

    Raises: TypeError where it returns anything else, or is no function that JAX can trace; what it raises itself goes
    on, with a note that names it.
    """
    return _returned(name, function, arguments, lambda out: _described(name, out))


def returned_leaves(name: str, function: Callable, *arguments) -> list[jax.ShapeDtypeStruct]:
    """The same for every leaf of the PyTree that a function returns; a leaf may also be a number."""
    leaf = lambda out: _described(name, np.asarray(out) if isinstance(out, float) else out)
    return _returned(name, function, arguments, lambda out: [leaf(part) for part in jax.tree.leaves(out)])


def _returned(name: str, function: Callable, arguments, describe: Callable) -> Any:
    """What is said of a function's outcome. JAX is handed nothing back: it would refuse in its own words."""
    found = []

    def call(function, *arguments):
        try:
            out = function(*arguments)
        except jax.errors.JAXTypeError as error:
            reason = str(error).split("\n")[0]
            raise TypeError(
                f"`{name}` must be a function that JAX can trace, but is not: {reason} Use jax.numpy in place of NumPy "
                "and math, and jnp.where in place of `if`."
            ) from error
        except Exception as error:
            error.add_note(f"Raised by `{name}`, which must return real numbers.")
            raise
        found.append(describe(out))

    eqx.filter_eval_shape(call, function, *arguments)
    return found[0]


def _described(name: str, value) -> jax.ShapeDtypeStruct:
    if not isinstance(value, jax.Array | np.ndarray):
        raise TypeError(f"`{name}` must return an array of real numbers, but returns {type(value).__name__}.")
    try:
        kind = jnp.asarray(value).dtype
    except (TypeError, ValueError) as error:  # NumPy has arrays that JAX has not: objects, texts, masks
        raise TypeError(
            f"`{name}` must return an array of real numbers, but returns {type(value).__name__} of {value.dtype}."
        ) from error
    if not jnp.issubdtype(kind, jnp.floating):
        raise TypeError(f"`{name}` must return real numbers, but returns {kind}.")
    return jax.ShapeDtypeStruct(value.shape, kind)
