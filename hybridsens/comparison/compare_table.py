"""A comparison of gradient methods: its rows, as text, as CSV and as a picture."""

import csv
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from ..export.datasets import optional
from ..export.one_move import in_one_move
from ..export.text import TERMINAL, name_and_numbers, preformatted, wrapped
from ..plot.figure import new_figure

COLUMNS = (
    "value", "value_error", "gradient_error", "forward_seconds", "gradient_seconds", "compile_seconds", "peak_memory",
)  # fmt: skip
HEAD = f"{'value':>14}{'value err':>11}{'gradient err':>13}{'forward':>11}{'gradient':>11}{'compile':>9}{'memory':>10}"


FINE = 1e-8
"""A relative error of a reference that is below all that is asked of methods."""


class Reference(NamedTuple):
    """What the rows are compared with."""

    value: float
    gradient: Float[np.ndarray, "parameter"]
    event_count: int | None = None
    """Number of events of the motion, the most of any if the cost asks for several."""
    doubt: str = ""
    """Why its gradient is not to be trusted, and no error of a gradient; empty where it is."""
    value_error: float = 0.0
    gradient_error: float = 0.0
    """By how much it is another at ten times its tolerance, relative as the errors of rows are, of which none below
    these is told."""

    @property
    def remark(self) -> str:
        """What is to be known of it; empty where it is exact, or nearly so."""
        if self.doubt or max(self.value_error, self.gradient_error) <= FINE:
            return self.doubt
        return (
            f"known to {self.value_error:.1e} in value and {self.gradient_error:.1e} in gradient alone, by which it is "
            "another at ten times its tolerance: no smaller error is told"
        )


class Row(NamedTuple):
    """What one method gave. Where it failed, `failure` says why and numbers are nan."""

    method: str
    value: float = np.nan
    gradient: Float[np.ndarray, "parameter"] | None = None
    value_error: float = np.nan
    """|J - J_ref| / |J_ref|."""
    gradient_error: float = np.nan
    """max_i |g_i - g_ref,i| / max_i |g_ref,i|."""
    forward_seconds: float = np.nan
    """One value [s]."""
    gradient_seconds: float = np.nan
    """One value with its gradient [s]."""
    compile_seconds: float = np.nan
    """First call of both [s]; short where JAX's persistent cache knows the programs."""
    peak_memory: float = np.nan
    """Of one gradient, by the compiler's plan [bytes]."""
    failure: str = ""


class Comparison(NamedTuple):
    """The table. Print it, write it (`to_csv`), or draw it (`hybridsens.plot_comparison`)."""

    parameters: tuple[str, ...]
    """Their names, in the order of the gradients."""
    reference: Reference
    """What the rows are compared with."""
    rows: tuple[Row, ...]
    """One for each method."""
    interrupted: bool = False
    """Whether Ctrl-C ended the run: the rows are those that were finished."""

    def __getitem__(self, method: str) -> Row:  # type: ignore[override]
        """The row of a method, by its name. Raises: KeyError for a name that is not there."""
        return {row.method: row for row in self.rows}[method]

    _repr_html_ = preformatted  # what a notebook shows

    def __str__(self) -> str:
        """Two tables of plain text: the methods with their errors and costs, and the entries of their gradients."""
        width = max([len(row.method) for row in self.rows], default=0) + 6
        beside = width + len(HEAD) <= TERMINAL
        lines = [name_and_numbers("", HEAD, width).lstrip("\n")]
        lines += [f"{'    reference':{width if beside else TERMINAL - len(HEAD)}}{self.reference.value:>14.9g}"]
        lines += [wrapped(f"    ({self.reference.remark})", 4)] if self.reference.remark else []
        lines += [_method_line(number, row, width) for number, row in enumerate(self.rows, 1)]
        if self.interrupted:
            lines.append("    (interrupted: the remaining methods were not run)")
        return "\n".join([*lines, "", *_gradient_lines(self)])

    def to_csv(self, path: str | Path) -> None:
        """Write one line for each method, the reference first, with one column for each entry of the gradient."""
        with in_one_move(Path(path)) as draft, open(draft, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(self._table())

    def to_pandas(self):
        """A pandas DataFrame of what `to_csv` writes, by method. Raises: ImportError without pandas."""
        head, *rows = self._table()
        return optional("pandas", "to_pandas()").DataFrame(rows, columns=head).set_index("method")

    def _table(self) -> list[list[Any]]:
        """Names of columns, the reference, and a row for each method."""
        reference, unknown = self.reference, [None] * (len(COLUMNS) - 1)
        table: list[list[Any]] = [["method", *COLUMNS, *(f"d/d {name}" for name in self.parameters), "failure"]]
        table.append(["reference", reference.value, *unknown, *reference.gradient, reference.remark])
        for row in self.rows:
            gradient = [None] * len(self.parameters) if row.gradient is None else row.gradient
            table.append([row.method, *(getattr(row, column) for column in COLUMNS), *gradient, row.failure])
        return table


def _method_line(number: int, row: Row, width: int) -> str:
    name = f"{number:>2}  {row.method}"
    if row.failure:
        return wrapped(f"{name}  failed: {row.failure}", 4)
    memory = "" if np.isnan(row.peak_memory) else _bytes(row.peak_memory)
    numbers = (
        f"{row.value:>14.9g}{row.value_error:>11.1e}{row.gradient_error:>13.1e}"
        f"{_time(row.forward_seconds):>11}{_time(row.gradient_seconds):>11}{row.compile_seconds:>7.1f} s{memory:>10}"
    )
    return name_and_numbers(name, numbers, width)


def _gradient_lines(comparison: Comparison):
    """Gradient by parameter, a few methods beside each other."""
    numbered = [(number, row) for number, row in enumerate(comparison.rows, 1) if row.gradient is not None]
    width = max(len(name) for name in ("dJ/d", *comparison.parameters)) + 2
    beside = max((TERMINAL - width) // 16 - 1, 1)  # the reference stands before each group
    for start in range(0, max(len(numbered), 1), beside):
        shown = numbered[start : start + beside]
        yield f"{'dJ/d':{width}}{'reference':>16}" + "".join(f"{f'({number})':>16}" for number, _ in shown)
        for i, name in enumerate(comparison.parameters):
            entries = [comparison.reference.gradient, *(row.gradient for _, row in shown)]
            yield f"{name:{width}}" + "".join(f"{entry[i]:>16.9g}" for entry in entries)


def _time(seconds: float) -> str:
    scale, unit = (1e6, "us") if seconds < 1e-3 else (1e3, "ms") if seconds < 1 else (1, "s ")
    return f"{scale * seconds:.3g} {unit}"


def _bytes(count: float) -> str:
    scale, unit = (1e3, "kB") if count < 1e6 else (1e6, "MB") if count < 1e9 else (1e9, "GB")
    return f"{count / scale:.3g} {unit}"


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
        axes.xaxis.set_minor_formatter(NullFormatter())  # labels of a short axis would lie on one another
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
