"""What a sweep shows while it runs, and the table of statuses that it ends with."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from ..status import Status
from ..waiting import in_notebook, lines
from .dataset import status_counts

if TYPE_CHECKING:
    import xarray as xr


@contextmanager
def progress_bar(points: int, present: int, shown: bool) -> Iterator[Callable[[int], None]]:
    """A bar with rate and time left; gives a function to be called with the number of points just done.

    Points that a resumed store already has count as done, but not towards the rate.
    """
    if not shown:
        yield lambda done: None
        return
    here = [present]
    told = lambda done: here.append(here[-1] + done) or f"sweep, {here[-1]:,} of {points:,} points"
    if in_notebook():  # where Rich has a bar only with a library of widgets
        with lines("compiling the sweep") as tell:
            yield lambda done: tell(told(done))
        return
    columns = (
        TextColumn("sweep"), BarColumn(bar_width=10), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(), TextColumn("elapsed,"), TimeRemainingColumn(), TextColumn("left"),
    )  # fmt: skip  # in 80 characters, also with a million points
    # The estimate looks back as far as it can: chunks take long, and a sweep's rate changes over its points.
    bar = Progress(*columns, speed_estimate_period=3600)
    # In a file the bar stands at the end alone.
    with bar, nullcontext() if bar.console.is_terminal else lines("compiling the sweep") as tell:
        task = bar.add_task("sweep", total=points, completed=present, rate="compiling")
        compiled: list[tuple[float, float]] = []

        def advance(done: int) -> None:
            """The rate is that since the program was compiled, which the first chunk waited for."""
            bar.advance(task, done)
            shown = bar.tasks[0]
            made, elapsed = shown.completed - present, shown.elapsed or 0.0
            before, since = compiled[0] if compiled else (0.0, elapsed)
            rate = f"{(made - before) / (elapsed - since):,.0f}/s" if elapsed > since else "compiled"
            bar.update(task, rate=rate)
            compiled.append((made, elapsed))
            if tell is not None:
                tell(told(done))

        yield advance


def print_statuses(dataset: "xr.Dataset") -> None:
    """How many points ended how, and what can be done about those that failed."""
    counts, meaning = status_counts(dataset), dict(zip(Status.names(), Status.messages(), strict=True))
    table = Table(title=f"{sum(counts.values()):,} points{_events_told(dataset)}", title_justify="left")
    table.add_column("status")
    table.add_column("points", justify="right")
    table.add_column("what to do")
    for name, count in counts.items():
        table.add_row(name, f"{count:,}", meaning.get(name, "run the sweep again: it goes on where it stopped."))
    Console().print(table)


def _events_told(dataset: "xr.Dataset") -> str:
    """How many events the points had: where none had any, what was swept may never have struck."""
    if "event_count" not in dataset:
        return ""
    found = dataset.event_count.values[dataset.status.values >= 0]
    return f", of {found.min()} to {found.max()} events" if found.size else ""
