"""`hybridsens check`, `compare` and `work-precision`: is a gradient right, by which methods, and at which cost."""

import inspect
from pathlib import Path
from typing import Annotated, Any

import diffrax
import typer

from ..adjoint import methods
from ..comparison.check_gradient import check_gradient
from ..comparison.compare import compare as run_compare
from ..comparison.compare_table import plot_comparison
from ..comparison.work_precision import plot_work_precision
from ..comparison.work_precision import work_precision as run_work_precision
from ..comparison.work_precision_points import COLUMNS, TARGETS
from ..validation.spelling import did_you_mean
from .models import HELP, complete, file_name, runnable
from .options import Json, file_to_write, names, picture_to_write, print_json

METHODS = ("Replay", "ForwardSensitivities", "ContinuousCostate", "DiffraxAdjoint")
"""Of `work-precision`."""


def check(
    scene: Annotated[str, typer.Argument(help=HELP, autocompletion=complete)] = "elastic-stop",
    parameters: Annotated[str, typer.Option(help="What to check: a,b[0],... Default: all.")] = "",
    tolerance: Annotated[float, typer.Option(help="How far differences may be off, relative to the entry.")] = 1e-5,
    max_events: Annotated[int, typer.Option(help="Room for events.")] = 256,
    max_steps: Annotated[int, typer.Option(help="Room for steps.")] = 16384,
    json: Json = False,
) -> None:
    """Check the gradient of a scene's functional by three methods and event by event; exit status 1 where in doubt.

    It takes a minute or more, most of it compilation.
    """
    result = check_gradient(
        runnable(scene), parameters=names(parameters) or None, tolerance=tolerance, max_events=max_events,
        max_steps=max_steps,
    )  # fmt: skip
    if json:
        print_json({"scene": scene, "ok": result.ok, **result._asdict()})
    else:
        print(f"{scene}: J = int running_cost dt\n\n{result}")
    if not result.ok:
        raise typer.Exit(1)


def compare(
    scene: Annotated[str, typer.Argument(help=HELP, autocompletion=complete)] = "elastic-stop",
    tolerance: Annotated[float, typer.Option(help="rtol and atol of the methods with error control.")] = 1e-8,
    steps: Annotated[int, typer.Option(help="Steps of the methods with a fixed step.")] = 10_000,
    output: Annotated[
        Path | None,
        typer.Option(callback=picture_to_write, help="Picture. Default: hybridsens-compare-SCENE.png here."),
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(callback=file_to_write, help="Also write the table to this CSV file.")
    ] = None,
) -> None:
    """Gradients by this package and by naive automatic differentiation: errors, times, memory. Ctrl-C keeps rows."""
    chosen = runnable(scene)
    result = run_compare(chosen, tolerance=tolerance, steps=steps)
    print(f"{scene}: J = int running_cost dt at tolerance {tolerance:g}, {steps} fixed steps\n\n{result}\n")
    if csv is not None:
        result.to_csv(csv)
        print(f"table: {csv}")
    output = output or Path(f"hybridsens-compare-{file_name(scene)}.png")
    plot_comparison(result).savefig(output, dpi=150)
    print(f"picture: {output}")


def work_precision(
    scene: Annotated[str, typer.Argument(help=HELP, autocompletion=complete)] = "elastic-stop",
    solver: Annotated[list[str] | None, typer.Option(help="Name of a Diffrax solver; repeat for more.")] = None,
    method: Annotated[list[str] | None, typer.Option(help=f"One of {', '.join(METHODS)}; repeat for more.")] = None,
    single: Annotated[bool, typer.Option(help="Measure float32 as well.")] = True,
    target: Annotated[float, typer.Option(help="Gradient error to recommend a setting for.")] = 1e-6,
    output: Annotated[
        Path | None, typer.Option(callback=picture_to_write, help="Picture. Default: work-precision-SCENE.png here.")
    ] = None,
    store: Annotated[
        Path | None,
        typer.Option(
            callback=file_to_write,
            help="Points, a .csv file; those in it are kept. Default: new ones, PICTURE-points.csv.",
        ),
    ] = None,
) -> None:
    """Errors of J and of its gradient against time per gradient, and the setting to choose. Ctrl-C keeps the points."""
    chosen = runnable(scene)
    output = output or Path(f"work-precision-{file_name(scene)}.png")
    store = store or _new_store(output)
    dtypes = ("float64", "float32") if single else ("float64",)
    solvers = [_solver(name) for name in solver or ("Bosh3", "Tsit5", "Dopri8")]
    methods = [_method(name) for name in method or ("Replay", "ForwardSensitivities")]
    study = run_work_precision(chosen, solvers=solvers, methods=methods, dtypes=dtypes, store=store)
    print(f"{scene}: J = int running_cost dt\n\n{study}")
    if target not in TARGETS:
        print(study.advice(target))
    print(f"\npoints: {store}")
    plot_work_precision(study).savefig(output, dpi=150)
    print(f"picture: {output}")


def _new_store(picture: Path) -> Path:
    """An empty place for points, beside the picture; the points of a study before are removed, no other file."""
    place = picture.with_name(f"{picture.stem}-points.csv")
    if place.exists() and place.read_bytes().partition(b"\r\n")[0] != ",".join(COLUMNS).encode():
        raise typer.BadParameter(f"{place} is there and holds no points of a study: name another file by --store")
    place.unlink(missing_ok=True)
    return place


def _solver(name: str) -> Any:
    kind = diffrax.AbstractAdaptiveSolver
    classes = {key: of for key, of in vars(diffrax).items() if inspect.isclass(of) and issubclass(of, kind)}
    known = {key: of for key, of in classes.items() if not key.startswith("Abstract")}
    if name not in known:
        raise typer.BadParameter(
            f"Diffrax has no solver with an error estimate of the name {name!r}.{did_you_mean(name, known)}"
        )
    return known[name]()


def _method(name: str) -> Any:
    if name not in METHODS:
        raise typer.BadParameter(
            f"there is no gradient method {name!r}; choose one of {', '.join(METHODS)}.{did_you_mean(name, METHODS)}"
        )
    return getattr(methods, name)()
