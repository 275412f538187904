"""What scenes and systems have in common, as classes with fields for parameters that a user writes."""

import contextlib
import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax.numpy as jnp

from .export.text import printed
from .validation.numbers import numbers_to_arrays
from .validation.spelling import warn_of_near_names


class Model(eqx.Module):
    """A class whose numbers become arrays, whose misspelt methods are told of, and that does not change."""

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        warn_of_near_names(cls)

    if not TYPE_CHECKING:  # a type checker would take the method for permission to assign fields

        def __setattr__(self, name, value):
            with _told_what_to_do(self, name):
                super().__setattr__(name, value)

    def __check_init__(self):
        numbers_to_arrays(self)

    def __repr__(self) -> str:
        return printed(self)


def parameter(default: Any):
    """A field for a parameter with a default: a number, or nested sequences of numbers for an array."""
    return eqx.field(default=default, converter=lambda value: jnp.asarray(value, jnp.result_type(float)))


@contextlib.contextmanager
def _told_what_to_do(module: Any, name: str) -> Iterator[None]:
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
