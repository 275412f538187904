"""A line on the terminal while somebody waits: for what, and for how long already. Elsewhere there is none."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

_SECONDS = "{task.elapsed:.0f} s"


@contextmanager
def waiting(what: str, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show "compiling ... 12 s" on the error stream while the block runs, then wipe it away.

    Gives a function that says what is waited for from now on. Nothing is shown if the stream is no terminal: a file
    would keep every line."""
    console = Console(stderr=True)
    if not (shown and console.is_terminal):
        yield lambda what: None
        return
    columns = TextColumn("{task.description} ..."), TextColumn(_SECONDS)
    with Progress(*columns, console=console, transient=True) as line:
        task = line.add_task(what)
        yield lambda what: line.update(task, description=what)


def counted(things: Iterable[Any], name: Callable[[Any], str], shown: bool) -> Iterator[Any]:
    """The things one after the other, with a bar that names the present one, and the time elapsed."""
    things, console = list(things), Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(_SECONDS)
    with Progress(*columns, console=console, transient=True, disable=not (shown and console.is_terminal)) as bar:
        task = bar.add_task("", total=len(things))
        for thing in things:
            bar.update(task, description=name(thing))
            yield thing
            bar.advance(task)
