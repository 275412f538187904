"""What a user's functions return, seen before anything runs: arrays of real numbers, or PyTrees of a wanted form."""

import contextlib
from collections.abc import Callable, Iterator
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
    """The same for every leaf of the PyTree that a function returns, which must have some; a leaf may also be a
    number."""
    leaf = lambda out: described(asked, np.asarray(out) if isinstance(out, float) else out)
    found = _returned(asked, arguments, lambda out: [leaf(part) for part in jax.tree.leaves(out)])
    if not found:
        raise TypeError(f"`{asked.name}` must return real numbers, but returns nothing: is a `return` missing?")
    return found


def _returned(asked: Asked, arguments, describe: Callable) -> Any:
    """What is said of a function's outcome. JAX is handed nothing back: it would refuse in its own words."""
    asked.must_be_callable(asked.function)
    found = []

    def call(function, *arguments):
        with _told(asked, ", which must return real numbers", arguments):
            out = asked.call(function, *arguments)
        found.append(describe(out))

    eqx.filter_eval_shape(call, asked.function, *arguments)
    return found[0]


@contextlib.contextmanager
def _told(asked: Asked, role: str, arguments: tuple) -> Iterator[None]:
    """While a function is traced: how to write one that JAX cannot trace, and a note to all else that it raises."""
    try:
        yield
    except jax.errors.JAXTypeError as error:
        reason = str(error).split("\n")[0].rstrip(".")
        raise TypeError(
            f"`{asked.name}` must be a function that JAX can trace, but is not: {reason}. Use jax.numpy in place of "
            "NumPy and math, and jnp.where or jax.lax.cond in place of `if`."
        ) from error
    except Exception as error:
        error.add_note(f"Raised by `{asked.name}`{role}.{_of_state(asked, arguments, str(error))}")
        raise


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
        where = ": write 1.0 in place of 1, in it or in a field that it uses"
        remedy = where if jnp.issubdtype(kind, jnp.integer) else ""
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
        remedy = _remedy(*expected) if shape == () and len(expected) == 1 else ""
        raise ValueError(
            f"`{asked.name}` must return an array of shape {wanted}, but {asked.it}returns shape {shape}{remedy}.{why}"
        )
    return returned


def _remedy(length: int | str) -> str:
    """For a number in the place of a vector."""
    if isinstance(length, int) and length > 1:
        return f": repeat the number by jnp.full({length}, ...)"
    return ": put the number into an array by jnp.array([...])"


def outcome(asked: Asked, *arguments) -> Any:
    """What a function returns, with its arrays described.

    Raises: TypeError where it takes other arguments, or JAX cannot trace it; what it raises itself goes on, with a note
    that names it."""
    with _told(asked, " of the system", arguments):
        return eqx.filter_eval_shape(asked.call, asked.function, *arguments)


def _of_state(asked: Asked, arguments, error: str) -> str:
    """What may be wrong with the state or the mode that a function of a system was given, in lines of a note."""
    given, note = dict(zip(asked.arguments, arguments, strict=False)), ""
    if "mode" in given and given["mode"] is None and "None" in error:
        note += "\nIts `mode` is None, as none was given: give the initial mode as the argument `mode`."
    for name, start in (("x", "x0"), ("mode", "mode")):
        if name in given and (row := _row_in(given[name])):
            note += f"\nIn its `{name}` there is a {row}, as in `{start}`, and no array: give a vector as "
            note += "`jnp.array([...])`."
    return note


def _row_in(x: Any) -> str:
    """The first list or plain tuple in a PyTree, by its type; "" if there is none."""
    is_row = lambda part: type(part) in (list, tuple)
    return next((type(part).__name__ for part in jax.tree.leaves(x, is_leaf=is_row) if is_row(part)), "")


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
        row = _row_in(wanted) if _is_array(found) else ""
        vector = f": a vector is no {row}, give `x0` as `jnp.array([...])`." if row else "."
        missing = ": is a `return` missing?" if found is None else vector
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


def _is_array(tree: Any) -> bool:
    return hasattr(tree, "shape") and hasattr(tree, "dtype")


def _dtype(leaf):
    return leaf.dtype if hasattr(leaf, "dtype") else jnp.asarray(leaf).dtype
