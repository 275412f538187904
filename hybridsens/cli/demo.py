"""`hybridsens demo`: a motion, its functional's gradient by three methods, and a picture."""

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from matplotlib.figure import Figure
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ..comparison.compare import relative_error, relative_errors
from ..comparison.demo import Demonstration, demonstrate
from ..export.names import contact_names
from ..export.text import MOST_ROWS, TERMINAL
from ..mechanics.event_table import impulse_of
from ..mechanics.mode import EventKind
from ..mechanics.trajectory import Trajectory
from ..plot import plot_gradients, plot_trajectory
from ..plot.solution import draw_solution
from ..solution import Solution, SolutionEvents
from ..waiting import waiting
from .models import HELP, complete, file_name, runnable, text
from .options import Json, picture_to_write, print_json


def demo(
    scene: Annotated[str, typer.Argument(help=HELP, autocompletion=complete)] = "elastic-stop",
    output: Annotated[
        Path | None,
        typer.Option(callback=picture_to_write, help="Picture: .png, .pdf, .svg. Default: hybridsens-SCENE.png here."),
    ] = None,
    tolerance: Annotated[float, typer.Option(help="Relative and absolute tolerance of the integration.")] = 1e-8,
    json: Json = False,
) -> None:
    """Run a scene; show its events, and its gradient beside differences and naive automatic differentiation."""
    chosen = runnable(scene)
    if not 1e-13 <= tolerance <= 1e-2:
        raise typer.BadParameter(f"the tolerance must lie between 1e-13 and 1e-2, but is {tolerance:g}")
    output = output or Path(f"hybridsens-{file_name(scene)}.png")
    with waiting("compiling the motion and its gradients", shown=True):
        shown = demonstrate(chosen, tolerance=tolerance)
    if json:
        print_json(_summary(scene, shown))
    else:
        _print(scene, chosen, shown)
    _picture(scene, chosen, shown).savefig(output, dpi=120)
    print(f"picture: {output}", file=sys.stderr if json else sys.stdout)


def _print(name: str, scene: Any, shown: Demonstration) -> None:
    console = Console(width=TERMINAL, highlight=False)
    about = _unwrapped(text(type(scene)))
    console.print(f"{name}: {about}\n" if about else f"{name}\n", markup=False)
    _print_events(console, scene, shown.trajectory)
    _print_gradients(console, shown)
    _print_timings(console, shown)


def _unwrapped(text: str) -> str:
    """Paragraphs without the line ends of the source, which a terminal of another width would wrap a second time."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def _events(motion: Trajectory | Solution) -> list[dict[str, Any]]:
    """What there is to say of each event."""
    events, n = motion.events, int(motion.events.count)
    time = np.asarray(events.time[:n]).tolist()
    if isinstance(events, SolutionEvents):
        return [dict(time=t, guard=int(guard)) for t, guard in zip(time, events.guard[:n], strict=True)]
    return [
        dict(
            time=time[j], kind=EventKind(int(events.kind[j])).name.lower(), contact=int(events.contact[j]),
            closing_speed=float(events.closing_speed[j]), impulse=impulse_of(events, j),
        )
        for j in range(n)
    ]  # fmt: skip


def _named(scene: Any, motion: Trajectory | Solution, row: dict[str, Any]) -> dict[str, str]:
    """The name of an event's guard or contact, for those who read."""
    if isinstance(motion, Solution):
        return {"guard": motion.events.name(row["guard"])}
    if row["kind"] == "switch":
        return {}
    names = contact_names(scene, motion.events.impulse.shape[-1])
    return {"contact": names[row["contact"]]}


def _summary(name: str, shown: Demonstration) -> dict[str, Any]:
    """What a program wants to know."""
    motion = shown.trajectory
    columns = zip(
        shown.names, shown.parameters.tolist(), shown.adjoint.tolist(), shown.differences.tolist(),
        shown.one_sided.tolist(), shown.naive.tolist(), strict=True,
    )  # fmt: skip
    keys = ("name", "value", "adjoint", "differences", "one_sided", "naive")
    return {
        "scene": name, "status": motion.status.name, "steps": motion.steps,
        "events": _events(motion), "J": shown.cost, "J_naive": shown.naive_cost,
        "gradient": [dict(zip(keys, column, strict=True)) for column in columns], "seconds": shown.timings,
    }  # fmt: skip


def _print_events(console: Console, scene: Any, motion: Trajectory | Solution) -> None:
    """The first and the last of them."""
    rows = [row | _named(scene, motion, row) for row in _events(motion)]
    accepted, rejected = int(motion.steps.accepted), int(motion.steps.rejected)
    print(f"status: {motion.status}")
    print(f"steps: {accepted} accepted, {rejected} rejected; events: {len(rows)}")
    if rows:
        table = Table(box=SIMPLE_HEAD)
        for heading in ("event", *(key.replace("_", " ") for key in rows[0])):
            table.add_column(heading, justify="right")
        for j, row in enumerate(rows):
            if len(rows) <= MOST_ROWS or j < MOST_ROWS // 2 or j >= len(rows) - MOST_ROWS // 2:
                table.add_row(str(j), *(f"{x:.9g}" if isinstance(x, float) else str(x) for x in row.values()))
            elif j == MOST_ROWS // 2:
                table.add_row("...", f"({len(rows) - MOST_ROWS} more)")
        console.print(table)


def _print_gradients(console: Console, shown: Demonstration) -> None:
    off = relative_error(shown.naive_cost, shown.cost)
    print(f"J = int running_cost dt = {shown.cost:.10g} (naive loop: {shown.naive_cost:.6g}, off by {off:.1e})")
    print("dJ/dtheta, with errors relative to the largest entry of the differences:")
    table = Table(box=SIMPLE_HEAD, padding=0)  # columns are a place apart; names of 23 letters fit in
    for heading in ("parameter", "jump adjoint", "differences", "error", "naive autodiff", "error"):
        table.add_column(heading, justify="left" if heading == "parameter" else "right", overflow="fold")
    errors = [relative_errors(values, shown.differences) for values in (shown.adjoint, shown.naive)]
    for i, name in enumerate(shown.names):
        mark = "*" if shown.one_sided[i] else " "
        table.add_row(
            name, f"{shown.adjoint[i]:.6g}", f"{shown.differences[i]:.6g}{mark}", f"{errors[0][i]:.0e}",
            f"{shown.naive[i]:.6g}", f"{errors[1][i]:.0e}",
        )  # fmt: skip
    console.print(table)
    if shown.one_sided.any():
        print("* from one side: the motion is not defined on the other")
    print(f"largest error: jump adjoint {errors[0].max():.1e}, naive autodiff {errors[1].max():.1e}\n")


def _print_timings(console: Console, shown: Demonstration) -> None:
    table = Table("program", box=SIMPLE_HEAD)
    table.add_column("first call", justify="right")
    table.add_column("one run", justify="right")
    for name, timing in shown.timings.items():
        table.add_row(name, f"{timing.first:.2f} s", f"{timing.run * 1e6:.0f} us")
    console.print(table)


def _picture(name: str, scene: Any, shown: Demonstration) -> Figure:
    """The motion to the left, the gradients to the right."""
    figure = Figure(figsize=(12, 5.5), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[1.6, 1])[0]
    if isinstance(shown.trajectory, Solution):
        draw_solution(shown.trajectory, left)
    else:
        plot_trajectory(scene, shown.trajectory, list(left.subplots(3, 1, sharex=True, height_ratios=[3, 3, 1])))
    axes = right.subplots()
    gradients = {"jump adjoint": shown.adjoint, "differences": shown.differences, "naive autodiff": shown.naive}
    plot_gradients(axes, shown.names, gradients)
    left.suptitle(f"{name}: motion", fontsize="medium")
    right.suptitle("gradient of J", fontsize="medium")
    return figure
