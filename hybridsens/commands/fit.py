"""`hybridsens fit`: parameters of a scene from a CSV file."""

import importlib.util
import inspect
from pathlib import Path
from typing import Annotated, Any

import typer

_SCENE = "A name from `hybridsens scenes`, or path/to/file.py:Class for a scene of your own."


def fit(
    scene: Annotated[str, typer.Argument(help=_SCENE)],
    data: Annotated[Path, typer.Option(help="CSV file with a header: t, then columns q0, v0, ...; sigma_q0, ...")],
    parameters: Annotated[str, typer.Option(help="What to fit: a,b,...")],
    columns: Annotated[str, typer.Option(help="Columns to use: q0,v0,... Default: all.")] = "",
    guess: Annotated[list[str] | None, typer.Option(help="NAME=VALUE, the scene's default otherwise.")] = None,
    bound: Annotated[list[str] | None, typer.Option(help="NAME=LO:HI, an end may be empty; NAME=positive.")] = None,
    sigma: Annotated[float | None, typer.Option(help="Of every value, if the file has no sigma_ columns.")] = None,
    optimizer: Annotated[
        str, typer.Option(help="levenberg-marquardt, gauss-newton, lbfgs or adam.")
    ] = "levenberg-marquardt",
    robust: Annotated[float | None, typer.Option(help="Residuals beyond so many sigmas count linearly.")] = None,
    starts: Annotated[int, typer.Option(help="Descend from so many points around the guess.")] = 1,
    grow: Annotated[bool, typer.Option(help="Fit the beginning first, then longer and longer parts.")] = False,
    skip_missing: Annotated[bool, typer.Option(help="Leave empty cells out instead of refusing them.")] = False,
    max_iterations: Annotated[int, typer.Option(help="Room for iterations.")] = 100,
    checkpoint: Annotated[
        Path | None, typer.Option(help="JSON file that keeps the best values at any time; a fit goes on from it.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of data, fit and residuals to write.")] = None,
    quiet: Annotated[bool, typer.Option(help="Print the result alone, no iterations.")] = False,
) -> None:
    """Fit parameters of a scene to measurements and print them with their intervals.

    Ctrl-C ends it with the best point so far.
    """
    from ..study.fit import GrowingHorizon, read_measurements
    from ..study.fit import fit as run_fit

    names = _split(columns)
    record = read_measurements(data, columns=names or None, sigma=sigma,
                               missing="skip" if skip_missing else "raise")  # fmt: skip
    result = run_fit(
        _with_guess(_scene(scene), guess or []), record, parameters=_split(parameters),
        bounds=dict(_bound(text) for text in bound or []), optimizer=optimizer, robust=robust, starts=starts,
        strategy=GrowingHorizon() if grow else None, max_iterations=max_iterations, progress=not quiet,
        checkpoint=checkpoint,
    )  # fmt: skip
    print(result)
    if plot is not None:
        result.plot().savefig(plot, dpi=120)
        print(f"picture: {plot}")
    if not result.converged:
        raise typer.Exit(1)


def _scene(name: str) -> Any:
    """A scene with its default parameters."""
    from ..mechanics.scene import AbstractScene
    from ..scenes import SCENES

    if name in SCENES:
        return SCENES[name]()
    file, _, class_name = name.rpartition(":")
    if not file:
        raise typer.BadParameter(f"there is no scene {name!r}; choose {', '.join(SCENES)} or path/to/file.py:Class")
    if not Path(file).is_file():
        raise typer.BadParameter(f"there is no file {file}")
    found = getattr(_load(Path(file)), class_name, None)
    if not (inspect.isclass(found) and issubclass(found, AbstractScene)):
        raise typer.BadParameter(f"{file} must have a hybridsens.AbstractScene {class_name!r}, but has none")
    return found()


def _load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise typer.BadParameter(f"{path} must be a Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _with_guess(scene: Any, guesses: list[str]) -> Any:
    from ..study.fit.parameters import select
    from ..study.fit.prepare import concrete

    if not guesses:
        return scene
    scene = concrete(scene)  # numbers that a class gives as plain Python floats are parameters too
    pairs = [text.partition("=")[::2] for text in guesses]
    selection = select(scene, [name for name, _ in pairs])
    return selection.insert(scene, _numbers([value for _, value in pairs], len(selection.labels)))


def _numbers(texts: list[str], count: int) -> Any:
    import jax.numpy as jnp

    try:
        numbers = [float(part) for text in texts for part in text.split(",")]
    except ValueError as error:
        raise typer.BadParameter(f"a guess must be NAME=NUMBER, but there is {texts}") from error
    if len(numbers) != count:
        raise typer.BadParameter(f"the guesses must have {count} numbers, but have {len(numbers)}")
    return jnp.asarray(numbers)


def _bound(text: str) -> tuple[str, Any]:
    name, _, ends = text.partition("=")
    if ends == "positive":
        return name, ends
    try:
        low, high = (float(end) if end else None for end in ends.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} must have the form NAME=LO:HI or NAME=positive") from error
    return name, (low, high)


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]
