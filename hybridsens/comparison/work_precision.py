"""Accuracy against time: error of J and of its gradient over solvers, tolerances, precisions and gradient methods, and
their picture."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..adjoint.methods import AbstractGradientMethod, ContinuousCostate, ForwardSensitivities, Replay
from ..parameters import flatten_parameters
from ..plot.figure import new_figure
from ..settings import Settings, check_solver, chosen_settings, finest_tolerance
from ..validation.arguments import real_tolerance
from ..waiting import counted
from .compare import Reference, tight_reference
from .compare_table import LEAST_ERROR
from .functional import Cost, choose_cost
from .gradient_methods import gradient_at_tolerances, name_with_settings
from .measure import measured, reason
from .work_precision_points import Point as Point
from .work_precision_points import WorkPrecision as WorkPrecision
from .work_precision_points import check_place, read_points, write_points

TOLERANCES = tuple(10.0**-k for k in range(3, 14))
"""1e-3 ... 1e-13."""


class Line(NamedTuple):
    """Points that share one compiled program."""

    dtype: str
    solver: diffrax.AbstractSolver
    method: AbstractGradientMethod
    tolerances: tuple[float, ...]

    @property
    def label(self) -> tuple[str, str, str]:
        """What names it, and all of its points but for their tolerance."""
        return name_with_settings(self.solver), name_with_settings(self.method), self.dtype


def work_precision(
    scene: Any,
    cost: Cost | None = None,
    *,
    solvers: Sequence[diffrax.AbstractSolver] = (diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri8()),
    tolerances: Sequence[float] = TOLERANCES,
    methods: Sequence[AbstractGradientMethod] = (Replay(), ForwardSensitivities(), ContinuousCostate()),
    dtypes: Sequence[str] = ("float64",),
    reference: Reference | None = None,
    store: str | Path | None = None,
    progress: bool = True,
    **settings: Unpack[Settings],
) -> WorkPrecision:
    """Error of a cost and of its gradient, and time for both, for every combination of settings.

    Arguments:

    - `scene`, `cost`, `reference`: as for `compare`.
    - `solvers`, `tolerances` (rtol = atol), `methods` (as for `adjoint=`), `dtypes` ("float64",
      "float32"): what is combined, without tolerances that a dtype cannot meet. A `ContinuousCostate()` is integrated
      at the tolerance of the motion.
    - `store`: a .csv file that each point is in as soon as it is finished. If it is there already, the
      study goes on from its points, which are not measured again. It must be of the same J, gradient and settings.
    - `progress`: show a bar. Ctrl-C ends the run and keeps the points that are finished.
    - `settings`: see `Settings`, but for those that are varied; 256 events and 65536 steps by default.

    A setting that fails is a point with its reason. float64 needs `hybridsens.configure()` before JAX starts.

    Raises: TypeError for one solver, tolerance, method or dtype where a list of them is asked for; ValueError for a
    tolerance that is not positive, a dtype other than these two, or a `store` that has another ending or the points of
    something else; SimulationError if the reference fails.
    """
    asked = dict(solvers=solvers, tolerances=tolerances, methods=methods, dtypes=dtypes)
    solvers, tolerances, methods, dtypes = (_listed(name, entries) for name, entries in asked.items())
    for tolerance in tolerances:
        real_tolerance("tolerances", tolerance)
    for solver in solvers:
        check_solver("solvers", solver)
    unknown = set(dtypes) - {"float64", "float32"}
    if unknown:
        raise ValueError(f'`dtypes` must have entries among "float64" and "float32", but has {sorted(unknown)}.')
    path = None if store is None else Path(store)
    if path is not None:
        check_place(path)
    own = dict(max_events=256, max_steps=65536)
    chosen = chosen_settings("work_precision", settings, own, varied=("solver", "rtol", "atol"))
    cost = choose_cost(scene, cost)
    reference = reference or tight_reference(flatten_parameters(scene), cost, chosen)
    points = [] if path is None else list(read_points(path, reference, chosen))
    combinations = itertools.product(dtypes, solvers, methods)
    lines = _missing([Line(*combined, _met(tolerances, combined[0])) for combined in combinations], points)
    beyond = tuple(dtype for dtype in dtypes if _met(tolerances, dtype) != tolerances)
    try:
        for line in counted(lines, lambda line: ", ".join(line.label), progress):
            for point in measure_line(scene, cost, line, reference, chosen):
                points.append(point)
                if path is not None:
                    write_points(path, points, reference, chosen)
    except KeyboardInterrupt:
        return WorkPrecision(tuple(points), True, beyond, reference)
    return WorkPrecision(tuple(points), False, beyond, reference)


def _listed(name: str, entries: Any) -> tuple:
    if isinstance(entries, str) or not isinstance(entries, Iterable):
        raise TypeError(f"`{name}` must be a list, but is {entries!r}. Write {name}=[{entries!r}].")
    return tuple(entries)


def _met(tolerances: tuple[float, ...], dtype: str) -> tuple[float, ...]:
    """Those that a dtype can meet: below them motions need ever more steps and gain nothing."""
    return tuple(tolerance for tolerance in tolerances if tolerance >= finest_tolerance(dtype))


def _missing(lines: list[Line], points: Sequence[Point]) -> list[Line]:
    """What is left to measure."""
    done = {point[:4] for point in points}
    still = lambda line: tuple(tolerance for tolerance in line.tolerances if (*line.label, tolerance) not in done)
    return [line._replace(tolerances=still(line)) for line in lines if still(line)]


def measure_line(scene, cost: Cost, line: Line, reference: Reference, settings) -> Iterator[Point]:
    """Points of one solver, method and dtype: one program for all tolerances. A failure stands in its point."""
    with jax.enable_x64(line.dtype == "float64"):  # what a scene makes out of nothing must have this type too
        cast = lambda leaf: jnp.asarray(leaf, line.dtype) if eqx.is_inexact_array(leaf) else leaf
        parameters = flatten_parameters(jax.tree.map(cast, scene))
        gradient = gradient_at_tolerances(line.method, parameters, cost, settings | dict(solver=line.solver))
        for tolerance in line.tolerances:
            try:
                found = measured(lambda t=tolerance: gradient(parameters.vector, t), reference)
                errors = found.value_error, found.gradient_error
                yield Point(*line.label, tolerance, *errors, found.seconds, found.first_seconds)
            except Exception as error:  # a setting that fails must not stop the study
                yield Point(*line.label, tolerance, failure=reason(error))


MARKS = "osD^vP*X<>"
DASHES = ("-", "--", "-.", ":")
SHADES = ("0.0", "0.45")
MOST_LETTERS = 130
"""Letters in a row of the legend, with five more for the line before each label."""


def plot_work_precision(study: WorkPrecision) -> Figure:
    """Errors of J and of its gradient against time per gradient; the Pareto front is drawn as a wide grey band.

    A mark for each solver, a dash for each gradient method, black for float64 and grey for float32: lines differ in
    mark and dash, so that they read in grey print.
    """
    figure = new_figure((10, 4.6))
    axes = figure.subplots(1, 2, sharey=False)
    for panel, error, title in zip(axes, ("value_error", "gradient_error"), ("J", "its gradient"), strict=True):
        front = study.pareto(error)
        panel.loglog(
            *_places(front, error),
            color="0.85", linewidth=9, solid_capstyle="round", label="Pareto front",
        )  # fmt: skip
        _lines(panel, study, error)
        panel.set(xlabel="time per gradient [ms]", ylabel=f"relative error of {title}")
        _tick_times(panel)
        panel.grid(color="0.9", linewidth=0.6)
        panel.set_axisbelow(True)
    _add_legend(figure, *axes[1].get_legend_handles_labels())
    return figure


def _tick_times(panel: Axes) -> None:
    """Ticks that do not run into each other. The axis spans a decade or more, so that it does not show the noise of the
    clock alone."""
    low, high = panel.get_xlim()
    middle = (low * high) ** 0.5
    panel.set_xlim(min(low, middle / 10**0.5), max(high, middle * 10**0.5))
    panel.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 1e3 * low else (1,)))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter(NullFormatter())


def _add_legend(figure: Figure, handles: list, labels: list[str]) -> None:
    """Below the panels, in as many columns as the figure has room for, and the figure is as much higher."""
    columns = min(4, max(1, MOST_LETTERS // (max(map(len, labels)) + 5)))
    figure.set_figheight(figure.get_figheight() + 0.2 * -(-len(labels) // columns))
    figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize="small",
        handlelength=3,  # long enough for a dash and a dot, which tell the methods
    )  # fmt: skip


def _lines(axes: Axes, study: WorkPrecision, error: str) -> None:
    groups: dict[tuple[str, str, str], list[Point]] = {}
    for point in study.points:
        if not point.failure and not point.is_reference:  # the error of that one is not known
            groups.setdefault((point.solver, point.method, point.dtype), []).append(point)
    if not groups:
        return
    solvers, methods, dtypes = (list(dict.fromkeys(column)) for column in zip(*groups, strict=True))
    for (solver, method, dtype), points in groups.items():
        label = ", ".join([solver, *([method] if len(methods) > 1 else []), *([dtype] if len(dtypes) > 1 else [])])
        axes.plot(
            *_places(points, error),
            marker=MARKS[solvers.index(solver) % len(MARKS)], linestyle=DASHES[methods.index(method) % len(DASHES)],
            color=SHADES[dtype == "float32"], linewidth=1, markersize=5, label=label,
        )  # fmt: skip


def _places(points: list[Point], error: str) -> tuple[list[float], list[float]]:
    """Times [ms] and errors; zero has no place on a logarithmic axis."""
    return [1e3 * point.seconds for point in points], [max(getattr(point, error), LEAST_ERROR) for point in points]
