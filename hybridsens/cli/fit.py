"""`hybridsens fit`: parameters of a scene from a CSV file."""

import contextlib
import functools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import jax.numpy as jnp
import typer

from ..parameters import parameter_places, split_name
from ..validation.spelling import did_you_mean
from ..waiting import waiting
from .models import HELP, complete, startable
from .options import Json, by_name, file_to_write, names, picture_to_write, print_json


def fit(
    scene: Annotated[str, typer.Argument(help=HELP, autocompletion=complete)],
    data: Annotated[Path, typer.Option(help="CSV file with a header: t [s], q0, v0, ...; sigma_q0, ...")],
    parameters: Annotated[str, typer.Option(help="What to fit: a,b[0],...")],
    time: Annotated[str, typer.Option(help="The column of times. Default: t or time.")] = "",
    columns: Annotated[str, typer.Option(help='Columns to use: q0,v0,..., or q0="Weg [m]". Default: all.')] = "",
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
    store: Annotated[
        Path | None,
        typer.Option(
            callback=file_to_write, help="JSON file that keeps the best values at any time; a fit goes on from it."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(callback=picture_to_write, help="Picture of data, fit and residuals: .png, .pdf, .svg."),
    ] = None,
    quiet: Annotated[bool, typer.Option(help="Print the result alone, no iterations.")] = False,
    json: Json = False,
) -> None:
    """Fit parameters of a scene to measurements and print them with their intervals.

    Ctrl-C ends it with the best point so far, once it iterates.
    """
    from ..estimation import GrowingHorizon, read_measurements  # takes as long as half of all other imports
    from ..estimation import fit as run_fit

    read = functools.partial(read_measurements, data, time=time or None, columns=_columns(columns),
                             missing="skip" if skip_missing else "raise")  # fmt: skip
    with _told_in_options():
        record = read()
        if sigma is not None:
            if record.sigmas is not None:
                raise typer.BadParameter(f"--sigma must be left out, since {data} has columns sigma_... of its own")
            record = read(sigma=sigma)
        result = run_fit(
            _with_guess(startable(scene), guess or []), record, parameters=names(parameters),
            bounds=by_name("--bound", bound or [], _bound), optimizer=optimizer, robust=robust, starts=starts,
            strategy=GrowingHorizon() if grow else None, max_iterations=max_iterations,
            progress=not (quiet or json), store=store,
        )  # fmt: skip
    if json:
        print_json(_summary(result))
    else:
        print(_in_options(str(result)))
    if output is not None:
        with waiting("drawing", shown=not (quiet or json)):
            result.plot().savefig(output, dpi=120)
        print(f"picture: {output}", file=sys.stderr if json else sys.stdout)
    if not result.converged:
        raise typer.Exit(1)


_OPTIONS = {
    "`strategy=GrowingHorizon()`": "--grow", "`starts=8`": "--starts 8", "`starts=`": "--starts",
    "`bounds`": "--bound", "`robust=3`": "--robust 3", "`missing=\"skip\"`": "--skip-missing", "`sigma`": "--sigma",
    "`columns`": "--columns", "`strategy=GrowingHorizon(": "in Python `strategy=hs.GrowingHorizon(",
}  # fmt: skip
"""What is said of arguments of `hybridsens.fit` -> what has their place in a terminal."""


def _in_options(text: str) -> str:
    for argument, option in _OPTIONS.items():
        text = text.replace(argument, option)
    return text


@contextlib.contextmanager
def _told_in_options() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(_in_options(str(error))) from error


def _summary(result: Any) -> dict[str, Any]:
    """What a program wants to know of a fit."""
    intervals, errors = result.intervals(), result.standard_errors
    values = zip(result.labels, result.guess.tolist(), result.values.tolist(), strict=True)
    return {
        "converged": result.converged, "stopped": result.stopped, "iterations": result.iterations,
        "loss": result.loss, "noise": result.uncertainty.noise, "on_bound": result.on_bound,
        "residual_correlation": result.residual_correlation,
        "undetermined": result.undetermined, "remarks": list(map(_in_options, result.remarks)),
        "parameters": [
            dict(name=name, guess=guess, value=value, standard_error=errors[name], interval_95=intervals[name])
            for name, guess, value in values
        ],
    }  # fmt: skip


def _columns(text: str) -> list[str] | dict[str, str] | None:
    """The columns to use; as NAME=COLUMN those that have other names in the file."""
    if "=" not in text:
        return names(text) or None
    pairs = (part.partition("=") for part in names(text))
    return {name.strip(): column.strip().strip("\"'") or name for name, _, column in pairs}  # a shell may leave quotes


def _with_guess(scene: Any, guesses: list[str]) -> Any:
    from ..estimation.parameters import select
    from ..estimation.prepare import concrete

    if not guesses:
        return scene
    scene = concrete(scene)  # numbers that a class gives as plain Python floats are parameters too
    given, known = by_name("--guess", guesses, _guess), list(parameter_places(scene))
    selection = select(scene, [_known(name, known) for name in given])
    numbers = [number for numbers in given.values() for number in numbers]
    if len(numbers) != len(selection.labels):
        raise typer.BadParameter(
            f"the guesses must have a number for each of {', '.join(selection.labels)}, but have {len(numbers)}"
        )
    return selection.insert(scene, jnp.asarray(numbers))


def _guess(text: str) -> tuple[str, list[float]]:
    name, _, numbers = text.partition("=")
    try:
        return name.strip(), [float(part) for part in numbers.split(",")]
    except ValueError as error:
        raise typer.BadParameter(
            f"a guess must have the form NAME=NUMBER, or NAME=NUMBER,NUMBER,... for an array, but is {text!r}"
        ) from error


def _known(name: str, known: list[str]) -> str:
    if name not in known and split_name(name)[0] not in known:
        raise typer.BadParameter(
            f"a guess must have a name among {', '.join(known)}, but has {name!r}.{did_you_mean(name, known)}"
        )
    return name


def _bound(text: str) -> tuple[str, Any]:
    name, _, ends = text.partition("=")
    if ends == "positive":
        return name.strip(), ends
    try:
        low, high = (float(end) if end else None for end in ends.split(":"))
    except ValueError as error:
        raise typer.BadParameter(f"{text!r} must have the form NAME=LO:HI or NAME=positive") from error
    return name.strip(), (low, high)
