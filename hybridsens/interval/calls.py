"""A walk over a trace; and its equations that call another program, and which function of JAX that is."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import jax
from jax.extend.core import Literal

CALLS = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat2"}
"""Primitives that hold a program of their own."""

_KNOWN = Path(jax.__file__).parent, Path(__file__).parents[1]
"""Where functions are written that are known by their names: in JAX, and here."""


def walked(jaxpr, given: Iterable[Any], of_number: Callable[[Any], Any], results: Callable[..., Sequence]) -> list[Any]:
    """What is known of the results of a program, from what is known of its constants and arguments.

    `results(equation, operands)` tells it of one equation, `of_number` of a number in the program."""
    known = dict(zip((*jaxpr.constvars, *jaxpr.invars), given, strict=True))
    read = lambda atom: of_number(atom) if isinstance(atom, Literal) else known[atom]
    for equation in jaxpr.eqns:
        found = results(equation, [read(atom) for atom in equation.invars])
        known.update(zip(equation.outvars, found, strict=True))
    return [read(atom) for atom in jaxpr.outvars]


def inner_jaxpr(equation):
    """The program that a call holds, with its constants."""
    inner = next(equation.params[name] for name in ("jaxpr", "call_jaxpr", "fun_jaxpr") if name in equation.params)
    return (inner.jaxpr, inner.consts) if hasattr(inner, "consts") else (inner, [])


def called(equation) -> str:
    """The name of the function of JAX, or of this package, that a call is of; "" for one that a user wrote, which may
    bear the same name."""
    written = inner_jaxpr(equation)[0].debug_info
    file = getattr(written, "func_filename", None)
    if file is not None and not any(Path(file).is_relative_to(folder) for folder in _KNOWN):
        return ""
    return equation.params.get("name") or getattr(written, "func_name", "")
