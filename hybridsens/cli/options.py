"""What commands share: files that can be written, what is given by name, results as JSON for a program to read."""

import enum
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer
from matplotlib.figure import Figure

Given = TypeVar("Given")
"""What is given by a name: a guess, bounds, a range."""


def file_to_write(path: Path | None) -> Path | None:
    """The path of a file that is written after what takes long. Raises: typer.BadParameter where it cannot be."""
    if path is not None and path.is_dir():
        raise typer.BadParameter(f"must be a file, but {path} is a folder: name a file in it")
    if path is not None and not path.parent.is_dir():
        raise typer.BadParameter(
            f"must lie in a folder that exists, but there is no folder {path.parent}: make it first, or name another"
        )
    return path


def picture_to_write(path: Path | None) -> Path | None:
    """The same for a picture, whose ending is its format."""
    formats = Figure().canvas.get_supported_filetypes()
    if path is not None and path.suffix.removeprefix(".") not in formats:
        raise typer.BadParameter(f"{path} must end in one of .{', .'.join(sorted(formats))}")
    return file_to_write(path)


def by_name(option: str, texts: Sequence[str], read: Callable[[str], tuple[str, Given]]) -> dict[str, Given]:
    """Name -> what was given for it, from texts NAME=... Raises: typer.BadParameter for a name that comes twice."""
    pairs = [read(text) for text in texts]
    for name, count in Counter(name for name, _ in pairs).items():
        if count > 1:
            given = ", ".join(text for text, (other, _) in zip(texts, pairs, strict=True) if other == name)
            raise typer.BadParameter(f"{option} must have each name once, but has {name!r} in {given}: leave one out")
    return dict(pairs)


def names(text: str) -> list[str]:
    """The names in a list; a comma in the brackets of mass[0, 1] parts none."""
    return [part.strip() for part in re.split(r",(?![^\[]*\])", text) if part.strip()]


Json = Annotated[bool, typer.Option("--json", help="Print JSON, for a program to read, and nothing else.")]


def print_json(result: Any) -> None:
    """Print a structure of dicts, lists, named tuples, numbers, texts and arrays: numbers in full, and null for what is
    not finite."""
    print(json.dumps(_plain(result), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, enum.Enum):
        return value.name.lower()
    if isinstance(value, str | bool | int) or value is None:
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return _plain(np.asarray(value).tolist())
