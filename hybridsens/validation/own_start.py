"""The start that a model speaks of itself, by which a start that does not fit is told of."""

import contextlib
import inspect
from typing import Any

import jax


def check_mode_given(model: Any, mode: Any, named: str) -> None:
    """Raise TypeError where no mode is given for a model that has an `initial_mode()`, `named` "scene" or "system"."""
    if mode is None and _own(model, "initial_mode") is not None:
        raise TypeError(
            f"`mode` must be given, since {type(model).__name__} has modes: it may be `{named}.initial_mode()`."
        )


def other_structure_told(system: Any, x: Any, mode: Any) -> str:
    """A sentence on a state or a mode that is not built as the system's own `initial_state()` or `initial_mode()`; ""
    where both are, or there are none."""
    for name, method, given in (("x0", "initial_state", x), ("mode", "initial_mode", mode)):
        own = _own(system, method)
        if own is not None and jax.tree.structure(own) != jax.tree.structure(given):
            return (
                f"`{name}` must be built as `system.{method}()`, which is {_built(own)} with a number or an array for "
                f"each *, but is {_built(given)}."
            )
    return ""


def _built(tree: Any) -> str:
    structure = jax.tree.structure(tree)
    return str(jax.tree.unflatten(structure, ["*"] * structure.num_leaves)).replace("'*'", "*")


def _own(model: Any, name: str) -> Any:
    """What a method without arguments returns; None where there is none, or it fails in its turn."""
    method: Any = getattr(model, name, None)
    try:
        inspect.signature(method).bind()
    except (TypeError, ValueError):
        return None
    with contextlib.suppress(Exception):  # the error that is being told of is another one
        return method()
    return None
