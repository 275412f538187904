"""Results as JSON on the output stream, for a program to read: numbers in full, and null for what is not finite."""

import enum
import json
import math
from typing import Annotated, Any

import numpy as np
import typer

Json = Annotated[bool, typer.Option("--json", help="Print JSON, for a program to read, and nothing else.")]


def print_json(result: Any) -> None:
    """Print a structure of dicts, lists, named tuples, numbers, texts and arrays."""
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
