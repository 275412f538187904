"""Scenes and systems by name, ready-made or of a class in a file, and what they say of themselves."""

import contextlib
import importlib.util
import inspect
import sys
from collections.abc import Collection
from pathlib import Path
from typing import Any

import typer

from .. import scenes
from ..comparison.functional import what_is_missing
from ..mechanics.scene import AbstractScene
from ..system import AbstractHybridSystem
from ..systems import SYSTEMS
from ..validation.spelling import did_you_mean

READY_MADE: dict[str, Any] = {**scenes.SCENES, **SYSTEMS}
"""Name -> class."""
FILE = "file_"
"""What the name of a module begins with that is a user's file: no library has one."""
HELP = "A name from `hybridsens scenes`, or path/to/file.py:Class for a scene or a system of your own."


def complete(incomplete: str) -> list[str]:
    """Ready-made names that begin so, for the shell."""
    return [name for name in READY_MADE if name.startswith(incomplete)]


def model(name: str) -> Any:
    """A scene or a system with its default parameters. Raises: typer.BadParameter if there is none."""
    if name in READY_MADE:
        return READY_MADE[name]()
    file, _, class_name = name.rpartition(":")
    if not file and Path(name).is_file():
        own = ", ".join(_own(_load(Path(name)))) or "no scene and no system"
        raise typer.BadParameter(f"{name} must be followed by the name of a class, {name}:Class; it has {own}")
    if not file:
        raise typer.BadParameter(
            f"there is no scene {name!r}; choose {', '.join(READY_MADE)} or path/to/file.py:Class."
            f"{_made_in_python(name) or did_you_mean(name, READY_MADE)}"
        )
    if not Path(file).is_file():
        raise typer.BadParameter(f"there is no file {file}")
    chosen = _class(file, class_name)
    try:
        return chosen()
    except TypeError as error:
        raise typer.BadParameter(
            f"{class_name} must have a default for every parameter, as by `mass: jax.Array = 1.0`, but {error}"
        ) from error
    except (ValueError, OSError, ImportError) as error:
        raise typer.BadParameter(
            f"{class_name} of {file} must be made by {class_name}(), which raises {type(error).__name__}: {error}"
        ) from error


def _made_in_python(name: str) -> str:
    """What to say of newtons-cradle: the scenes of any size have no name here."""
    of = name.title().replace("-", "")
    if not isinstance(getattr(scenes, of, None), type):
        return ""
    return f" A {of} of any size is made in Python: hybridsens.scenes.{of}, from which a class in a file may derive."


def file_name(name: str) -> str:
    """What files of results are named after."""
    return name.rpartition(":")[2]


def startable(name: str) -> Any:
    """A model that says by itself where it starts."""
    found = model(name)
    if not hasattr(found, "initial_state"):
        raise typer.BadParameter(
            f"{name} must have a method `initial_state(self)`, which says where its motion begins, but has none"
        )
    return found


def runnable(name: str, given: Collection[str] = ()) -> Any:
    """A model that says by itself where it starts, how long it runs and what it costs, but for what options give."""
    found = model(name)
    missing = [needed for needed in what_is_missing(found) if needed not in given]
    if missing:
        raise typer.BadParameter(
            f"{name} must have {', '.join(missing)}: write it in the class, as `t1 = 10.0`, or derive that from "
            "hybridsens.scenes.ShippedScene or hybridsens.systems.ShippedSystem"
        )
    return found


def _class(file: str, name: str) -> Any:
    module = _load(Path(file))
    models, own = _models(module), _own(module)
    if name not in models:
        raise typer.BadParameter(
            f"{file} must have a hybridsens.AbstractScene or AbstractHybridSystem {name!r}, but has "
            f"{', '.join(own) or 'none at all'}.{did_you_mean(name, own)}"
        )
    return models[name]


def _models(module: Any) -> dict[str, type]:
    """Scenes and systems by name."""
    kinds = (AbstractScene, AbstractHybridSystem)
    return {key: value for key, value in vars(module).items() if inspect.isclass(value) and issubclass(value, kinds)}


def _own(module: Any) -> list[str]:
    """Those that the file itself defines."""
    return [key for key, value in _models(module).items() if value.__module__ == module.__name__]


def _load(path: Path) -> Any:
    """The file as a module. Raises: typer.BadParameter for what cannot be read, with the file and the line of it."""
    spec = importlib.util.spec_from_file_location(FILE + path.stem, path)
    if spec is None or spec.loader is None:
        raise typer.BadParameter(f"{path} must be a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where Python looks for the source of its classes
    try:
        with contextlib.redirect_stdout(sys.stderr):  # what the file prints is none of the command's output
            spec.loader.exec_module(module)
    except SyntaxError as error:
        raise typer.BadParameter(
            f"{path} must be a Python file, but line {error.lineno} of {error.filename} cannot be read: {error.msg}"
        ) from error
    except (ValueError, OSError, ImportError) as error:
        raise typer.BadParameter(
            f"{path} must run as a Python file, but raises {type(error).__name__}: {error}"
        ) from error
    return module


def about(of: type) -> str:
    """The first line of its module: what it is; its own text where the module has none."""
    module = inspect.getmodule(of)
    return ((inspect.getdoc(module) if module is not None else None) or text(of)).partition("\n")[0]


def text(of: type) -> str:
    """The text of a class; empty where it has only the signature that Python puts in its place."""
    found = inspect.getdoc(of) or ""
    return "" if found.startswith(f"{of.__name__}(") else found
