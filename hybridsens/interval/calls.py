"""Equations of a trace that call another program, and which function of JAX that is."""

from pathlib import Path

import jax

CALLS = {"jit", "pjit", "closed_call", "core_call", "custom_jvp_call", "custom_vjp_call", "checkpoint", "remat2"}
"""Primitives that hold a program of their own."""

_KNOWN = Path(jax.__file__).parent, Path(__file__).parents[1]
"""Where functions are written that are known by their names: in JAX, and here."""


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
