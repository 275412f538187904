"""PyTrees that a user's functions return: told from a trace, and compared with what they must be."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .asked import Asked


def outcome(asked: Asked, *arguments) -> Any:
    """What a function returns, with its arrays described.

    Raises: TypeError where it takes other arguments, or JAX cannot trace it; what it raises itself goes on, with a note
    that names it."""
    try:
        return eqx.filter_eval_shape(asked.call, asked.function, *arguments)
    except jax.errors.JAXTypeError as error:
        reason = str(error).split("\n")[0]
        raise TypeError(
            f"`{asked.name}` must be a function that JAX can trace, but is not: {reason} Use jax.numpy in place of "
            "NumPy and math, and jnp.where or jax.lax.cond in place of `if`."
        ) from error
    except Exception as error:
        error.add_note(f"Raised by `{asked.name}` of the system.")
        if asked.form.endswith(", mode)") and arguments[-1] is None:
            error.add_note("Its `mode` is None: give the initial mode as the third argument of `solve`.")
        raise


def must_be_pair(asked: Asked, returned: Any, parts: str) -> None:
    """Raise TypeError where a function does not return two things."""
    if not isinstance(returned, tuple) or len(returned) != 2:
        said = f"{len(returned)} things" if isinstance(returned, tuple) else form(returned)
        raise TypeError(
            f"`{asked.name}` must return {parts}, but {asked.it}returns {said}: write `return {parts.strip('()')}`."
        )


def must_match(asked: Asked, what: str, found: Any, wanted: Any, exact: bool) -> None:
    """Raise ValueError or TypeError where structure, shapes or (if `exact`) types differ."""
    must = f"`{asked.name}` must return {what}"
    if jax.tree.structure(found) != jax.tree.structure(wanted):
        missing = ": is a `return` missing?" if found is None else "."
        raise ValueError(
            f"{must} as a PyTree of the form {form(wanted)}, but {asked.it}returns {form(found)}{missing}"
        )
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        one_type, shape = _dtype(one), np.shape(one)
        if shape != other.shape or (exact and one_type != other.dtype):
            raise ValueError(
                f"{must} with leaves of the shapes and types before, but {asked.it}returns "
                f"{one_type}{list(shape)} in place of {other.dtype}{list(other.shape)}."
            )
        if not exact and not jnp.issubdtype(one_type, jnp.floating):
            raise TypeError(f"{must} in real numbers, but {asked.it}returns {one_type}.")


def form(tree: Any) -> str:
    """A PyTree in a word or two: "f64[2]", "(f64[], None)", "{'height': f64[]}"."""
    return " ".join(eqx.tree_pformat(tree, struct_as_array=True).split())


def _dtype(leaf):
    return leaf.dtype if hasattr(leaf, "dtype") else jnp.asarray(leaf).dtype
