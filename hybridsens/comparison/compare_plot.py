"""A comparison as a picture: error of each gradient, and what it costs. It reads the same in grey print."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..plot.figure import new_figure
from .compare_table import Comparison, Row

LEAST_ERROR = 1e-16
"""An error of zero is drawn here."""
WRONG = 1e-3
"""A gradient with a larger error is hatched."""


def plot_comparison(comparison: Comparison) -> Figure:
    """Gradient error and time of every method as bars with their numbers, on logarithmic axes.

    A gradient whose error is above `WRONG` is hatched. A method that failed is named, without bars.
    """
    rows = list(reversed(comparison.rows))
    figure = new_figure((9, 0.42 * len(rows) + 1.3))
    error_axes, time_axes = figure.subplots(1, 2, sharey=True, width_ratios=[3, 2])
    for place, row in enumerate(rows):
        if row.failure:
            error_axes.annotate(" failed", (0, place), xycoords=("axes fraction", "data"), va="center", style="italic")
            continue
        _bar(error_axes, place, max(row.gradient_error, LEAST_ERROR), f"{row.gradient_error:.0e}", _style(row))
        _bar(time_axes, place, row.gradient_seconds, f"{1e3 * row.gradient_seconds:.2g} ms", _style(row))
    error_axes.set_yticks(range(len(rows)), [row.method for row in rows])
    error_axes.set_xlabel(f"relative error of the gradient (hatched: above {WRONG:g})")
    time_axes.set_xlabel("time per gradient [s]")
    for axes in (error_axes, time_axes):
        axes.set_xscale("log")
        axes.margins(x=0.3)
        axes.grid(axis="x", color="0.85", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _style(row: Row) -> dict[str, str]:
    if row.gradient_error > WRONG:
        return dict(facecolor="white", hatch="////")
    return dict(facecolor="0.35")


def _bar(axes: Axes, place: int, length: float, label: str, style: dict[str, str]) -> None:
    bars = axes.barh(place, length, height=0.6, edgecolor="black", linewidth=0.8, **style)  # type: ignore[arg-type]
    axes.bar_label(bars, [label], padding=3, fontsize="small")
