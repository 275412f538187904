"""`hybridsens work-precision`: accuracy against time on a ready-made scene."""

import inspect
from pathlib import Path
from typing import Annotated, Any

import diffrax
import typer

from ..adjoint import methods
from ..comparison.work_precision import work_precision as run
from ..comparison.work_precision_plot import plot_work_precision
from ..comparison.work_precision_points import COLUMNS, TARGETS
from ..validation.spelling import did_you_mean
from .models import HELP, complete, file_name, runnable
from .options import file_to_write, picture_to_write

METHODS = ("Replay", "ForwardSensitivities", "ContinuousCostate", "DiffraxAdjoint")


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
    study = run(chosen, solvers=solvers, methods=methods, dtypes=dtypes, store=store)
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
