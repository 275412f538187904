"""`hybridsens sweep`: value and gradient of a ready-made scene over a grid or a random design of its parameters."""

import math
import os
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from ..comparison.functional import move, ready_made_motion
from ..configure import configure
from ..export.datasets import write_netcdf
from ..validation.spelling import did_you_mean
from .models import HELP, complete, runnable
from .options import by_name, file_to_write, picture_to_write
from .scenes import parameter_texts


def _output(path: Path) -> Path:
    """Where results go; a store makes its folders by itself."""
    if path.suffix not in (".zarr", ".nc"):
        raise typer.BadParameter(f"{path} must end in .zarr or .nc")
    if path.suffix == ".nc":
        file_to_write(path)
    return path


def _end(t1: float | None) -> float | None:
    """The end of motions that start at 0: without a length no point of a sweep would have a value."""
    if t1 is not None and not 0 < t1 < math.inf:
        raise typer.BadParameter(f"must be later than 0, where the motions start, and finite, but is {t1:g}")
    return t1


_Vary = Annotated[list[str], typer.Option(help="NAME=LOW:HIGH:COUNT; a design other than a grid takes NAME=LOW:HIGH.")]


def sweep(
    scene: Annotated[str, typer.Argument(help=HELP, autocompletion=complete)],
    vary: _Vary,
    output: Annotated[
        Path,
        typer.Option(
            callback=_output, help="A .zarr store, streamed to and resumed, or a .nc file written at the end."
        ),
    ],
    design: Annotated[str, typer.Option(help="grid, random, latin-hypercube, sobol or saltelli.")] = "grid",
    points: Annotated[
        int | None,
        typer.Option(help="Number of points of a design other than a grid (saltelli: its base). Default: 1024."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of a design other than a grid. Default: 0.")] = None,
    plot: Annotated[
        Path | None,
        typer.Option(callback=picture_to_write, help="Picture of the maps to write (a grid of two parameters)."),
    ] = None,
    t1: Annotated[
        float | None, typer.Option(callback=_end, help="End of the horizon. Default: the scene's own.")
    ] = None,
    tolerance: Annotated[float, typer.Option(help="Relative and absolute tolerance of the integration.")] = 1e-8,
    events: Annotated[int, typer.Option(help="How many of the first events of each point are written.")] = 8,
    max_events: Annotated[int, typer.Option(help="Room for events at each point.")] = 256,
    max_steps: Annotated[int, typer.Option(help="Room for steps at each point.")] = 4096,
    chunk: Annotated[int, typer.Option(help="Points run and written at once.")] = 8192,
) -> None:
    """Run a scene at many points on all cores: J, its gradient, status and events of each."""
    from ..sweeps import plot_sweep  # SciPy's designs take a third as long as all other imports
    from ..sweeps import sweep as run_sweep

    _use_all_cores()
    nominal = runnable(scene, given=() if t1 is None else ("t1",))
    chosen = _design(nominal, vary, design, points, seed)
    if plot is not None:
        _check_map(chosen)
    end = nominal.t1 if t1 is None else t1
    cost = _cost(end, tolerance, max_events, max_steps)
    store = output if output.suffix == ".zarr" else None
    units = {row.name: row.unit for row in parameter_texts(nominal) if row.unit}
    about = {"made_by": f"hybridsens {version('hybridsens')}", "t1": float(end), "tolerance": tolerance}
    dataset = run_sweep(cost, chosen, events=events, store=store, chunk=chunk, units=units, about=about)
    if store is None:
        write_netcdf(dataset, output)
    print(f"results: {output}")
    if plot is not None:
        plot_sweep(dataset).savefig(plot, dpi=120)
        print(f"picture: {plot}")
    if not np.isfinite(dataset.J).any():
        print("No point has a value: see the table above.")
        raise typer.Exit(1)


def _use_all_cores() -> None:
    try:
        configure(host_devices=os.cpu_count())
    except RuntimeError:  # JAX has started already (in a test, say): then with the devices that it has
        return


def _cost(t1, tolerance, max_events, max_steps):
    settings = dict(t1=t1, rtol=tolerance, atol=tolerance, max_events=max_events, max_steps=max_steps, throw=False)

    def cost(scene):
        motion = ready_made_motion(scene, move, **settings)
        return motion.cost, motion

    return cost


def _design(scene, vary: list[str], kind: str, points: int | None, seed: int | None):
    from ..sweeps import designs

    ranges = by_name("--vary", vary, _range)
    if kind == "grid":
        short = [name for name, numbers in ranges.items() if len(numbers) != 3]
        if short:
            raise typer.BadParameter(f"a grid needs NAME=LOW:HIGH:COUNT for {', '.join(short)}")
        for option, given in (("--points", points), ("--seed", seed)):
            if given is not None:
                raise typer.BadParameter(f"{option} must be left out for a grid, or --design must name another design")
        return designs.grid(
            scene, {name: np.linspace(low, high, int(count)) for name, (low, high, count) in ranges.items()}
        )
    makers = {
        "random": designs.random,
        "latin-hypercube": designs.latin_hypercube,
        "sobol": designs.sobol,
        "saltelli": designs.saltelli,
    }
    if kind not in makers:
        known = ["grid", *makers]
        raise typer.BadParameter(
            f"the design must be one of {', '.join(known)}, but is {kind!r}.{did_you_mean(kind, known)}"
        )
    counted = [name for name, numbers in ranges.items() if len(numbers) == 3]
    if counted:
        raise typer.BadParameter(
            f"a {kind} design takes NAME=LOW:HIGH for {', '.join(counted)}: how many points there are is --points"
        )
    box = {name: (low, high) for name, (low, high) in ranges.items()}
    return makers[kind](scene, box, 1024 if points is None else points, 0 if seed is None else seed)


def _check_map(design) -> None:
    if design.kind != "grid" or len(design.shape) != 2:
        raise typer.BadParameter(
            f"--plot must have a grid of two parameters to draw, but the design is {design.kind} in "
            f"{', '.join(design.columns)}: leave --plot out, or vary two parameters on a grid"
        )


def _range(text: str) -> tuple[str, list[float]]:
    name, _, numbers = text.partition("=")
    try:
        values = [float(part) for part in numbers.split(":")]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or (len(values) == 3 and (values[2] < 1 or not values[2].is_integer())):
        raise typer.BadParameter(f"{text!r} must have the form NAME=LOW:HIGH or NAME=LOW:HIGH:COUNT")
    return name.strip(), values
