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


def other_structure_told(system: Any, x: Any) -> str:
    """A sentence on a state that is not built as the system's own `initial_state()`; "" where it is, or there is
    none."""
    own = _own(system, "initial_state")
    if own is None or jax.tree.structure(own) == jax.tree.structure(x):
        return ""
    return (
        f"`x0` must be built as `system.initial_state()`, which is {_built(own)} with a number or an array for each *, "
        f"but is {_built(x)}."
    )


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
