"""`hybridsens check`: is the gradient of a scene right?"""

from typing import Annotated

import typer

from ..comparison.check_gradient import check_gradient
from .models import HELP, complete, runnable
from .options import Json, names, print_json


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
