"""`hybridsens demo`: a motion, the gradient of its functional beside a naive one, and a picture."""

import functools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import typer
from matplotlib.figure import Figure

from ..adjoint.methods import Replay
from ..comparison.baselines import where_reset, where_transition
from ..comparison.compare import measure_method
from ..comparison.compare_table import Comparison, Reference
from ..comparison.differentiate import best_finite_differences
from ..comparison.functional import move, ready_made_motion, running_cost_functional
from ..comparison.gradient_methods import GradientMethod, from_adjoint
from ..export.text import TERMINAL, wrapped
from ..mechanics.event_table import impulse_of
from ..mechanics.mode import EventKind
from ..mechanics.switches import has_switches
from ..mechanics.trajectory import Trajectory
from ..parameters import FlatParameters, flatten_parameters
from ..plot import plot_gradients, plot_trajectory
from ..plot.solution import draw_solution
from ..solution import Solution
from ..system import AbstractHybridSystem
from ..waiting import waiting
from .models import HELP, complete, file_name, runnable, text
from .options import Json, picture_to_write, print_json

TIGHT = dict(rtol=1e-12, atol=1e-12, max_steps=2**16)
"""Settings of the motions that differences are taken of: they divide the noise of step selection by their width."""
SAMPLES = 2001
NAIVE_STEPS = 20_000


class Demonstration(NamedTuple):
    """What is shown of a scene."""

    motion: Trajectory | Solution
    comparison: Comparison
    """The jump adjoint and the naive loop, beside differences as the reference."""
    one_sided: list[str]
    """Parameters whose differences could be taken to one side only (a coefficient of restitution of 1, say)."""


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
        shown = demonstrate(chosen, tolerance)
    if json:
        print_json(_summary(scene, shown))
    else:
        print("\n".join(_report(scene, text(type(chosen)), shown)))
    _picture(scene, chosen, shown).savefig(output, dpi=120)
    print(f"picture: {output}", file=sys.stderr if json else sys.stdout)


def demonstrate(scene: Any, tolerance: float) -> Demonstration:
    """Run a scene or a system, ready-made or one's own, and differentiate its functional by the jump adjoint, by a
    naive loop, and by differences.

    Raises: SimulationError if the motion does not reach its end; ValueError for a setting that `simulate` refuses, and
    for a scene with switches of its own.
    """
    if has_switches(scene):
        raise ValueError(
            "demo compares with a loop that knows impacts alone, but the scene has switches of its own: use "
            "`hybridsens check`, or `simulate`."
        )
    settings = dict(rtol=tolerance, atol=tolerance)
    motion = ready_made_motion(scene, move, ts=jnp.linspace(0.0, scene.t1, SAMPLES), **settings)
    parameters = flatten_parameters(scene)
    reference, one_sided = _differences(parameters)
    loop = where_transition if isinstance(scene, AbstractHybridSystem) else where_reset
    methods = (
        from_adjoint(Replay(), **settings)._replace(name="jump adjoint"),
        GradientMethod("naive autodiff", functools.partial(loop, steps=NAIVE_STEPS), "reverse"),
    )
    rows = tuple(measure_method(method, parameters, running_cost_functional, reference) for method in methods)
    return Demonstration(motion, Comparison(parameters.names, reference, rows), one_sided)


def _differences(parameters: FlatParameters) -> tuple[Reference, list[str]]:
    """J and its gradient by the best of five widths, nan where no motion reaches its end; and in which parameters the
    other side has none."""
    J = jax.jit(lambda vector: ready_made_motion(parameters.rebuild(vector), move, throw="nan", **TIGHT).cost)
    vector = np.asarray(parameters.vector)
    found = best_finite_differences(J, vector, np.where(vector == 0, 1.0, np.abs(vector)))
    one_sided = np.array(parameters.names)[found.one_sided].tolist()
    return Reference(float(J(vector)), found.slopes), one_sided


def _report(name: str, about: str, shown: Demonstration) -> Iterator[str]:
    """Lines of a terminal."""
    yield _filled(f"{name}: {about}" if about else name) + "\n"
    yield from _lines_of(shown.motion)
    yield "\nJ = int running_cost dt and its gradient; the reference is differences of J.\n"
    yield f"{shown.comparison}\n"
    if shown.one_sided:
        names = ", ".join(shown.one_sided)
        yield wrapped(f"(differences from one side, as there is no motion on the other: {names})", 1)
    off = ", ".join(f"{row.method} {row.gradient_error:.1e}" for row in shown.comparison.rows)
    yield f"largest error of the gradient: {off}"


def _filled(text: str) -> str:
    """Paragraphs without the line ends of the source, each filled anew."""
    return "\n\n".join(wrapped(" ".join(part.split()), 0) for part in text.split("\n\n"))


def _lines_of(motion: Trajectory | Solution) -> Iterator[str]:
    """The text of a motion; where its table of events is too wide, that ends before its last column, the states."""
    lines = str(motion).splitlines()
    row = re.compile(r"event | *(\d+|\.\.\.) ")
    table = [line for line in lines if row.match(line)]
    end = table[0].rfind("  ") if any(len(line) > TERMINAL for line in table) else None
    for line in lines:
        yield line[:end] if line in table else wrapped(line, 4)


def _summary(name: str, shown: Demonstration) -> dict[str, Any]:
    """What a program wants to know."""
    motion = shown.motion
    return {
        "scene": name, "status": motion.status.name, "steps": motion.steps, "events": _events(motion),
        **shown.comparison._asdict(), "one_sided": shown.one_sided,
    }  # fmt: skip


def _events(motion: Trajectory | Solution) -> list[dict[str, Any]]:
    """What there is to say of each event."""
    n = int(motion.events.count)
    if isinstance(motion, Solution):
        return [dict(time=motion.events.time[j], guard=motion.events.guard[j]) for j in range(n)]
    events = motion.events
    return [
        dict(
            time=events.time[j], kind=EventKind(int(events.kind[j])), contact=events.contact[j],
            closing_speed=events.closing_speed[j], impulse=impulse_of(events, j),
        )
        for j in range(n)
    ]  # fmt: skip


def _picture(name: str, scene: Any, shown: Demonstration) -> Figure:
    """The motion to the left, the gradients to the right."""
    figure = Figure(figsize=(12, 5.5), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[1.6, 1])[0]
    if isinstance(shown.motion, Solution):
        draw_solution(shown.motion, left)
    else:
        plot_trajectory(scene, shown.motion, list(left.subplots(3, 1, sharex=True, height_ratios=[3, 3, 1])))
    adjoint, naive = shown.comparison.rows
    gradients = {adjoint.method: adjoint.gradient, "differences": shown.comparison.reference.gradient,
                 naive.method: naive.gradient}  # fmt: skip
    known = {method: slopes for method, slopes in gradients.items() if slopes is not None}
    plot_gradients(right.subplots(), list(shown.comparison.parameters), known)
    left.suptitle(f"{name}: motion", fontsize="medium")
    right.suptitle("gradient of J", fontsize="medium")
    return figure
