"""PyTrees that a user's functions return: told from a trace, and compared with what they must be."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np


def outcome(name: str, function: Callable, *arguments) -> Any:
    """What a function returns, with its arrays described.

    Raises: TypeError where JAX cannot trace it; what it raises itself goes on, with a note that names it."""
    try:
        return eqx.filter_eval_shape(function, *arguments)
    except jax.errors.JAXTypeError as error:
        reason = str(error).split("\n")[0]
        raise TypeError(
            f"`{name}` must be a function that JAX can trace, but is not: {reason} Use jax.numpy in place of NumPy and "
            "math, and jnp.where or jax.lax.cond in place of `if`."
        ) from error
    except Exception as error:
        error.add_note(f"Raised by `{name}` of the system.")
        raise


def must_be_pair(name: str, returned: Any, parts: str) -> None:
    """Raise TypeError where a function does not return two things."""
    if not isinstance(returned, tuple) or len(returned) != 2:
        said = f"{len(returned)} things" if isinstance(returned, tuple) else type(returned).__name__
        raise TypeError(f"`{name}` must return {parts}, but returns {said}.")


def must_match(name: str, what: str, found: Any, wanted: Any, exact: bool) -> None:
    """Raise ValueError or TypeError where structure, shapes or (if `exact`) types differ."""
    if jax.tree.structure(found) != jax.tree.structure(wanted):
        raise ValueError(
            f"`{name}` must return {what} as a PyTree of the structure {jax.tree.structure(wanted)}, but returns "
            f"{jax.tree.structure(found)}."
        )
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        one_type, shape = _dtype(one), np.shape(one)
        if shape != other.shape or (exact and one_type != other.dtype):
            raise ValueError(
                f"`{name}` must return {what} with leaves of the shapes and types before, but returns "
                f"{one_type}{list(shape)} in place of {other.dtype}{list(other.shape)}."
            )
        if not exact and not jnp.issubdtype(one_type, jnp.floating):
            raise TypeError(f"`{name}` must return {what} in real numbers, but returns {one_type}.")


def _dtype(leaf):
    return leaf.dtype if hasattr(leaf, "dtype") else jnp.asarray(leaf).dtype
