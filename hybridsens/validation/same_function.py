"""A function that is written in place, made anew at each call: the one that was made before, where both do the same."""

import math
import types
import weakref
from collections.abc import Hashable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

STEADY = (jax, jnp, jax.lax, np, math)
"""Modules that hold the same functions later."""

_MADE: weakref.WeakValueDictionary[Hashable, Any] = weakref.WeakValueDictionary()
"""Those made before, as long as a program that was compiled of one holds it."""


def same_function(function: Any) -> Any:
    """The function that was made of the same lines before, or this one.

    JAX knows functions by their identity, so that `running_cost=lambda scene, t, q, v: q @ q` inside of a cost would be
    compiled at each call of that cost. The earlier one serves where all that they name outside of themselves is numbers
    and JAX's own modules: an array, a function of the user, or what is closed over may have changed since."""
    if type(function) is not types.FunctionType or _holds_something(function):
        return function
    named = list(_globals_named(function))
    if not all(map(_stays, named)):
        return function
    key = function.__code__, id(function.__globals__), tuple((type(value), value) for value in named)
    return _MADE.setdefault(key, function)


def _holds_something(function: types.FunctionType) -> bool:
    return bool(function.__closure__ or function.__defaults__ or function.__kwdefaults__ or vars(function))


def _stays(value: Any) -> bool:
    return isinstance(value, int | float | str) or any(value is module for module in STEADY)


def _globals_named(function: types.FunctionType) -> Iterator[Any]:
    """What the function names of its file, and what functions inside of it do."""
    codes = [function.__code__]
    for code in codes:  # which grows on the way
        codes += [constant for constant in code.co_consts if isinstance(constant, types.CodeType)]
        yield from (function.__globals__[name] for name in code.co_names if name in function.__globals__)
