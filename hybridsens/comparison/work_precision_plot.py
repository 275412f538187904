"""A work-precision study as a picture. Lines differ in mark and dash, so it reads in grey print."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from ..plot.figure import new_figure
from .compare_table import LEAST_ERROR
from .work_precision_points import Point, WorkPrecision

MARKS = "osD^vP*X<>"
DASHES = ("-", "--", "-.", ":")
SHADES = ("0.0", "0.45")
MOST_LETTERS = 130
"""Letters in a row of the legend, with five more for the line before each label."""


def plot_work_precision(study: WorkPrecision) -> Figure:
    """Errors of J and of its gradient against time per gradient; the Pareto front is drawn as a wide grey band.

    A mark for each solver, a dash for each gradient method, black for float64 and grey for float32.
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
