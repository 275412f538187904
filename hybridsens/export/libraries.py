"""Libraries that only the ways out need: imported when they are asked for, and named with their extra if missing."""

from importlib import import_module
from typing import Any


def optional(library: str, wanted_by: str, extra: str = "tables") -> Any:
    """The library. Raises: ImportError that says what asked for it and which extra brings it."""
    try:
        return import_module(library)
    except ImportError as error:
        raise ImportError(
            f"{wanted_by} needs {library}, which is not installed: pip install 'hybridsens[{extra}]'."
        ) from error
