"""`hybridsens demo`: a motion, its functional's gradient by three methods, and a picture."""

import inspect
from pathlib import Path
from typing import Annotated

import typer
from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..comparison.demo import Demonstration, demonstrate, relative_errors
from ..plot import plot_gradients, plot_trajectory
from ..plot.solution import draw_solution
from ..scenes import ShippedScene
from ..solution import Solution
from ..systems import ShippedSystem
from .models import HELP, file_name, runnable

WIDTH = 110


def demo(
    scene: Annotated[str, typer.Argument(help=HELP)] = "elastic-stop",
    output: Annotated[Path | None, typer.Option(help="Picture to write. Default: hybridsens-SCENE.png here.")] = None,
    tolerance: Annotated[float, typer.Option(help="Relative and absolute tolerance of the integration.")] = 1e-8,
) -> None:
    """Run a scene; show its events, and its gradient beside differences and naive automatic differentiation."""
    chosen = runnable(scene)
    if not 1e-13 <= tolerance <= 1e-2:
        raise typer.BadParameter(f"the tolerance must lie between 1e-13 and 1e-2, but is {tolerance:g}")
    output = _writable(output or Path(f"hybridsens-{file_name(scene)}.png"))
    shown = demonstrate(chosen, tolerance=tolerance)
    console = Console(width=WIDTH, highlight=False)
    print(f"{scene}: {inspect.getdoc(chosen)}\n\n{shown.trajectory}\n")
    _print_gradients(console, shown)
    _print_timings(console, shown)
    _picture(scene, chosen, shown).savefig(output, dpi=120)
    print(f"picture: {output}")


def _writable(output: Path) -> Path:
    formats = Figure().canvas.get_supported_filetypes()
    if output.suffix.removeprefix(".") not in formats:
        raise typer.BadParameter(f"{output} must end in one of .{', .'.join(sorted(formats))}")
    if not output.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {output.parent} to write the picture to")
    return output


def _print_gradients(console: Console, shown: Demonstration) -> None:
    off = abs(shown.naive_cost - shown.cost) / abs(shown.cost)
    print(f"J = int running_cost dt = {shown.cost:.12g}   (naive loop: {shown.naive_cost:.6g}, off by {off:.1e})")
    print("dJ/dtheta, with errors relative to the largest entry of the differences:")
    table = Table(box=SIMPLE_HEAD)
    for heading in ("parameter", "value", "jump adjoint", "differences", "error", "naive autodiff", "error"):
        table.add_column(heading, justify="left" if heading == "parameter" else "right")
    errors = [relative_errors(values, shown.differences) for values in (shown.adjoint, shown.naive)]
    for i, name in enumerate(shown.names):
        mark = "*" if shown.one_sided[i] else " "
        table.add_row(
            name, f"{shown.parameters[i]:.6g}", f"{shown.adjoint[i]:.9g}", f"{shown.differences[i]:.9g}{mark}",
            f"{errors[0][i]:.1e}", f"{shown.naive[i]:.6g}", f"{errors[1][i]:.1e}",
        )  # fmt: skip
    console.print(table)
    if shown.one_sided.any():
        print("* from one side: the motion is not defined on the other")
    print(f"largest error: jump adjoint {errors[0].max():.1e}, naive autodiff {errors[1].max():.1e}\n")


def _print_timings(console: Console, shown: Demonstration) -> None:
    table = Table("program", box=SIMPLE_HEAD)
    table.add_column("compile once", justify="right")
    table.add_column("one run", justify="right")
    for name, timing in shown.timings.items():
        table.add_row(name, f"{timing.compile:.2f} s", f"{timing.run * 1e6:.0f} us")
    console.print(table)


def _picture(name: str, scene: ShippedScene | ShippedSystem, shown: Demonstration) -> Figure:
    """The motion to the left, the gradients to the right."""
    figure = Figure(figsize=(12, 5.5), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[1.6, 1])[0]
    if isinstance(shown.trajectory, Solution):
        draw_solution(shown.trajectory, left)
    elif isinstance(scene, ShippedScene):
        plot_trajectory(scene, shown.trajectory, list(left.subplots(3, 1, sharex=True, height_ratios=[3, 3, 1])))
    axes = right.subplots()
    gradients = {"jump adjoint": shown.adjoint, "differences": shown.differences, "naive autodiff": shown.naive}
    plot_gradients(axes, shown.names, gradients)
    left.suptitle(f"{name}: motion", fontsize="medium")
    right.suptitle("gradient of J", fontsize="medium")
    return figure
