"""What scenes and systems have in common, as classes with fields for parameters that a user writes."""

from typing import TYPE_CHECKING

import equinox as eqx

from .export.text import printed
from .validation.frozen import told_what_to_do
from .validation.numbers import numbers_to_arrays
from .validation.spelling import warn_of_near_names


class Model(eqx.Module):
    """A class whose numbers become arrays, whose misspelt methods are told of, and that does not change."""

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        warn_of_near_names(cls)

    if not TYPE_CHECKING:  # a type checker would take the method for permission to assign fields

        def __setattr__(self, name, value):
            with told_what_to_do(self, name):
                super().__setattr__(name, value)

    def __check_init__(self):
        numbers_to_arrays(self)

    def __repr__(self) -> str:
        return printed(self)
