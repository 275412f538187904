"""`hybridsens scenes`: what there is to run, and what can be varied in it."""

import ast
import inspect
import re
import textwrap
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer

from ..export.text import TERMINAL
from ..parameters import parameters
from ..scenes import SCENES
from ..systems import SYSTEMS
from .models import about, complete, model, text
from .options import Json, print_json


class ParameterText(NamedTuple):
    """One parameter, as a reader wants it."""

    name: str
    default: Any
    """A number, or nested lists of them."""
    unit: str
    """Empty where the text names none."""
    about: str


def scenes(
    name: Annotated[
        str,
        typer.Argument(help="One of them, or path/to/file.py:Class, to list its parameters.", autocompletion=complete),
    ] = "",
    json: Json = False,
) -> None:
    """List the ready-made scenes and hybrid systems, or the parameters of one with units and defaults."""
    if json:
        names = [name] if name else [*SCENES, *SYSTEMS]
        print_json([_described(one) for one in names])
    elif name:
        _print_one(name)
    else:
        _print_all()


def _described(name: str) -> dict[str, Any]:
    of = model(name)
    return {"name": name, "about": about(type(of)), "t1": getattr(of, "t1", None), "parameters": parameter_texts(of)}


def _print_all() -> None:
    width = max(map(len, [*SCENES, *SYSTEMS])) + 4
    for heading, models in (("mechanical scenes", SCENES), ("hybrid systems", SYSTEMS)):
        print(f"{heading}:")
        for name, of in models.items():
            print(textwrap.fill(f"{f'  {name}':<{width}}{about(of)}", TERMINAL, subsequent_indent=" " * width))
    print("\n`hybridsens scenes NAME` lists the parameters of one.")


def _print_one(name: str) -> None:
    of = model(name)
    first, paragraphs = about(type(of)), text(type(of)).split("\n\n")
    if paragraphs[0].startswith(first):  # where the module has no text, the class speaks for it
        first = paragraphs.pop(0)
    for paragraph in (f"{name}: {first or type(of).__name__}", *filter(None, paragraphs)):
        print(textwrap.fill(paragraph, TERMINAL) + "\n")
    rows = parameter_texts(of)
    width = max(map(len, ["parameter", *(row.name for row in rows)])) + 2
    print(f"{'parameter':<{width}} {'default':<12} {'unit':<8} meaning")
    for row in rows:
        first = f"{row.name:<{width}} {_default(row):<12} {row.unit:<8} {row.about}"
        print(textwrap.fill(first, TERMINAL, subsequent_indent=" " * (width + 23)).rstrip())


def _default(row: ParameterText) -> str:
    """A number, or the shape of an array."""
    if not isinstance(row.default, list):
        return f"{row.default:.6g}"
    if any(isinstance(number, list) for number in row.default):
        return f"{len(row.default)} x {len(row.default[0])}"
    numbers = ", ".join(f"{number:g}" for number in row.default)
    return f"[{numbers}]" if len(numbers) < 11 else f"{len(row.default)} numbers"


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
