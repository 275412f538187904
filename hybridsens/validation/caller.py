"""Warnings that name the line of the program that called this package."""

import inspect
import sysconfig
import warnings
from pathlib import Path

_LIBRARIES = tuple({sysconfig.get_path(kind) for kind in ("stdlib", "platstdlib", "purelib", "platlib")})
_BETWEEN = (str(Path(__file__).parents[1]), *_LIBRARIES, "<string>", "<frozen", "<@")
"""Beginnings of the files between the program and a warning: this package, libraries, and what these generate."""


def warn_caller(message: str, category: type[Warning] = UserWarning) -> None:
    """`warnings.warn`, from the line that called this package."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_BETWEEN):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
