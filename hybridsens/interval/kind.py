"""How a traced function depends on its arguments, entry by entry, told from its trace alone."""

import enum
from collections.abc import Sequence
from typing import Any

import numpy as np

from .calls import CALLS, inner_jaxpr, walked
from .primitives import BINARY, LINEAR_SHAPES, LOGIC, PLACED, UNARY
from .tables import is_interpolation


class Kind(enum.IntEnum):
    """What is known of an entry; the worst of several wins."""

    CONSTANT = 0
    AFFINE = 1
    CURVED = 2
    """Made by operations that have a rule in interval arithmetic."""
    UNKNOWN = 3
    """Made by an operation that has none."""


SUMS = {"add", "add_any", "sub", "neg"}
OTHERS = {"integer_pow", "clamp", "dot_general", "select_n", "convert_element_type"}
RULES = UNARY.keys() | BINARY.keys() | LOGIC.keys() | LINEAR_SHAPES | PLACED.keys() | OTHERS
MOVES = {
    "broadcast_in_dim": lambda p, x: _broadcast(x, p["shape"], p["broadcast_dimensions"]),
    "concatenate": lambda p, *x: np.concatenate(x, p["dimension"]),
    "reshape": lambda p, x: x.reshape(p["new_sizes"]),
    "slice": lambda p, x: x[_slices(p)],
    "squeeze": lambda p, x: np.squeeze(x, tuple(p["dimensions"])),
    "stack": lambda p, *x: np.stack(x, p["axis"]),
    "transpose": lambda p, x: np.transpose(x, p["permutation"]),
}
"""Operations that put each entry somewhere: a floor stays a floor beside a curved wall."""


def kinds(closed_jaxpr, arguments: Sequence[Any]) -> np.ndarray:
    """Kind of each entry of the one result, in the shape of it, from the kinds of the arguments' entries."""
    constants = [np.zeros(variable.aval.shape, int) for variable in closed_jaxpr.jaxpr.constvars]
    return _run(closed_jaxpr.jaxpr, constants, arguments)[0]


def _run(jaxpr, constants, arguments) -> list[np.ndarray]:
    constant = lambda atom: np.zeros(np.shape(atom.val), int)
    return walked(jaxpr, (*constants, *arguments), constant, _kinds)


def _kinds(equation, operands: list[np.ndarray]) -> list[np.ndarray]:
    name, shapes = equation.primitive.name, [variable.aval.shape for variable in equation.outvars]
    worst = max((int(x.max(initial=0)) for x in operands), default=0)
    if worst == Kind.CONSTANT:
        return [np.zeros(shape, int) for shape in shapes]
    if name in CALLS:
        if not any(x.any() for x in operands[1:]) and is_interpolation(equation):
            return [np.broadcast_to(np.where(operands[0] > 0, np.maximum(operands[0], Kind.CURVED), 0), *shapes)]
        jaxpr, constants = inner_jaxpr(equation)
        return _run(jaxpr, [np.zeros(np.shape(x), int) for x in constants], operands)
    if name == "cond" and not operands[0].any():  # by the mode, say
        branches = equation.params["branches"]
        cases = [_run(b.jaxpr, [np.zeros(np.shape(x), int) for x in b.consts], operands[1:]) for b in branches]
        return [np.asarray(np.maximum.reduce(results)) for results in zip(*cases, strict=True)]
    if name == "unstack":
        return [np.asarray(np.take(operands[0], k, equation.params["axis"])) for k in range(len(shapes))]
    if name == "split":
        return np.split(operands[0], np.cumsum(equation.params["sizes"])[:-1], equation.params["axis"])
    if name in MOVES:
        return [MOVES[name](equation.params, *operands)]
    if name in UNARY or name in BINARY:
        worst = operands[0] if len(operands) == 1 else np.maximum(*operands)
    if name not in RULES or not _keeps_numbers(equation, operands):
        kind = np.asarray(Kind.UNKNOWN)
    elif _is_linear(name, operands):
        kind = worst
    else:
        kind = np.where(np.asarray(worst) > 0, np.maximum(worst, Kind.CURVED), 0)
    return [np.broadcast_to(kind, shape) for shape in shapes]


def _is_linear(name: str, operands) -> bool:
    fixed = [not x.any() for x in operands]
    if name in {"mul", "dot_general"}:
        return any(fixed)
    if name == "select_n":  # by the mode, say
        return fixed[0]
    return name in SUMS | LINEAR_SHAPES | PLACED.keys() | {"convert_element_type"} or (name == "div" and fixed[1])


def _keeps_numbers(equation, operands) -> bool:
    """Whether entries are read from or put to places that are constant, and conversions are to real numbers."""
    name = equation.primitive.name
    if name in PLACED:
        return not any(x.any() for k, x in enumerate(operands) if k not in PLACED[name])
    if name != "convert_element_type":
        return True
    old, new = equation.invars[0].aval.dtype, equation.params["new_dtype"]
    return np.issubdtype(new, np.floating) or old == new


def _broadcast(x, shape, dimensions):
    spread = [1] * len(shape)
    for size, dimension in zip(x.shape, dimensions, strict=True):
        spread[dimension] = size
    return np.broadcast_to(x.reshape(spread), shape)


def _slices(params):
    strides = params["strides"] or [1] * len(params["start_indices"])
    return tuple(slice(*s) for s in zip(params["start_indices"], params["limit_indices"], strides, strict=True))
