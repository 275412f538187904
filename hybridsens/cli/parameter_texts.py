"""What the parameters of a scene or a system are: the texts below the fields of its classes."""

import ast
import inspect
import re
import textwrap
from typing import Any, NamedTuple

import numpy as np

from ..parameters import parameters


class ParameterText(NamedTuple):
    """One parameter, as a reader wants it."""

    name: str
    default: Any
    """A number, or nested lists of them."""
    unit: str
    """Empty where the text names none."""
    about: str


def parameter_texts(model: Any) -> list[ParameterText]:
    """The parameters of a scene or a system, with their present values, units and meanings."""
    texts = {}
    for of in reversed(type(model).__mro__):
        texts |= _field_texts(of)
    return [_parameter(name, value, texts.get(name.partition(".")[0], "")) for name, value in parameters(model).items()]


def _parameter(name: str, value: Any, text: str) -> ParameterText:
    """The unit stands in brackets in the text: "Initial height [m]."; what has a comma there is an interval."""
    unit = re.search(r"\s*\[([^\],]*)\]", text)
    about = text if unit is None else text[: unit.start()] + text[unit.end() :]
    return ParameterText(name, np.asarray(value).tolist(), unit[1] if unit else "", " ".join(about.split()).strip(" ."))


def _field_texts(of: type) -> dict[str, str]:
    """Field -> the string below it, for the fields that one class adds."""
    try:
        source = inspect.getsource(of)
    except (OSError, TypeError):  # a class made without a file
        return {}
    body = next(node for node in ast.walk(ast.parse(textwrap.dedent(source))) if isinstance(node, ast.ClassDef)).body
    texts = {}
    for field, below in zip(body, body[1:], strict=False):
        is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and is_text:
            texts[field.target.id] = str(below.value.value)  # type: ignore[attr-defined]
    return texts
