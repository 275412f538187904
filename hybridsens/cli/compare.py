"""`hybridsens compare`: gradient methods side by side on a ready-made scene."""

from pathlib import Path
from typing import Annotated

import typer

from ..comparison.compare import compare as run
from ..comparison.compare_table import plot_comparison
from .models import HELP, complete, file_name, runnable
from .options import file_to_write, picture_to_write


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
    result = run(chosen, tolerance=tolerance, steps=steps)
    print(f"{scene}: J = int running_cost dt at tolerance {tolerance:g}, {steps} fixed steps\n\n{result}\n")
    if csv is not None:
        result.to_csv(csv)
        print(f"table: {csv}")
    output = output or Path(f"hybridsens-compare-{file_name(scene)}.png")
    plot_comparison(result).savefig(output, dpi=150)
    print(f"picture: {output}")
