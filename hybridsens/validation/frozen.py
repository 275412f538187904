"""Scenes and systems do not change. What to do instead of an assignment."""

import contextlib
import dataclasses
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def told_what_to_do(module: Any, name: str) -> Iterator[None]:
    """Around an assignment to `module.name`: Equinox refuses one to what is not a field, and one after the making.

    Raises: dataclasses.FrozenInstanceError, which is an AttributeError."""
    try:
        yield
    except dataclasses.FrozenInstanceError as error:
        kind = type(module).__name__
        if name not in {field.name for field in dataclasses.fields(module)}:
            raise dataclasses.FrozenInstanceError(
                f"`{name}` must be declared in the class {kind}, by a line `{name}: jax.Array`, to be set in its "
                "`__init__`. A class without an `__init__` gets one that takes all fields."
            ) from error
        raise dataclasses.FrozenInstanceError(
            f"`{name}` cannot be assigned to: a {kind} does not change once it is made. Make another one, "
            f"{kind}(...), or `equinox.tree_at(lambda it: it.{name}, old, jnp.array(...))`."
        ) from error
