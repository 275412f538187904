"""What a scene's functions return, seen before anything runs: named where it is no array of real numbers."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .asked import Asked


def returned_array(asked: Asked, *arguments) -> jax.ShapeDtypeStruct:
    """Shape and type of the one array that a function returns.

    Raises: TypeError where it returns anything else, takes other arguments, or is no function that JAX can trace; what
    it raises itself goes on, with a note that names it.
    """
    return _returned(asked, arguments, lambda out: described(asked, out))


def returned_leaves(asked: Asked, *arguments) -> list[jax.ShapeDtypeStruct]:
    """The same for every leaf of the PyTree that a function returns; a leaf may also be a number."""
    leaf = lambda out: described(asked, np.asarray(out) if isinstance(out, float) else out)
    return _returned(asked, arguments, lambda out: [leaf(part) for part in jax.tree.leaves(out)])


def _returned(asked: Asked, arguments, describe: Callable) -> Any:
    """What is said of a function's outcome. JAX is handed nothing back: it would refuse in its own words."""
    found = []

    def call(function, *arguments):
        try:
            out = asked.call(function, *arguments)
        except jax.errors.JAXTypeError as error:
            reason = str(error).split("\n")[0]
            raise TypeError(
                f"`{asked.name}` must be a function that JAX can trace, but is not: {reason} Use jax.numpy in place of "
                "NumPy and math, and jnp.where in place of `if`."
            ) from error
        except Exception as error:
            error.add_note(f"Raised by `{asked.name}`, which must return real numbers.")
            raise
        found.append(describe(out))

    eqx.filter_eval_shape(call, asked.function, *arguments)
    return found[0]


def described(asked: Asked, value) -> jax.ShapeDtypeStruct:
    """Shape and type of an array of real numbers. Raises: TypeError where it is none."""
    must = f"`{asked.name}` must return an array of real numbers, but {asked.it}returns"
    if value is None:
        raise TypeError(f"{must} None: is a `return` missing?")
    if not isinstance(value, jax.Array | np.ndarray):
        remedy = ": make it an array by jnp.array(...)" if isinstance(value, int | float | tuple | list) else ""
        raise TypeError(f"{must} {type(value).__name__}{remedy}.")
    try:
        kind = jnp.asarray(value).dtype
    except (TypeError, ValueError) as error:  # NumPy has arrays that JAX has not: objects, texts, masks
        raise TypeError(f"{must} {type(value).__name__} of {value.dtype}.") from error
    if not jnp.issubdtype(kind, jnp.floating):
        remedy = ": write 1.0 in place of 1" if jnp.issubdtype(kind, jnp.integer) else ""
        raise TypeError(f"`{asked.name}` must return real numbers, but {asked.it}returns {kind}{remedy}.")
    return jax.ShapeDtypeStruct(value.shape, kind)


def must_have_shape(
    asked: Asked, returned: jax.ShapeDtypeStruct, expected: tuple[int | str, ...], why: str = ""
) -> jax.ShapeDtypeStruct:
    """What is returned. Raises: ValueError where it has another shape; a name stands for any length."""
    shape = returned.shape
    of_other_length = lambda found, wanted: isinstance(wanted, int) and found != wanted
    if len(shape) != len(expected) or any(map(of_other_length, shape, expected)):
        wanted = f"({', '.join(map(str, expected))}{',' if len(expected) == 1 else ''})"
        remedy = ": put the number into an array by jnp.array([...])" if shape == () and len(expected) == 1 else ""
        raise ValueError(
            f"`{asked.name}` must return an array of shape {wanted}, but {asked.it}returns shape {shape}{remedy}.{why}"
        )
    return returned
