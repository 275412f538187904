"""Progress lines on a terminal or in a notebook: what is computed, and for how long. Elsewhere there are none."""

import contextvars
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

TICK = 1.0
"""Seconds between two changes of the line in a notebook."""
_SECONDS = "{task.elapsed:.0f} s"


@contextmanager
def waiting(what: str, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show "compiling ... 12 s" on the error stream, or below a notebook's cell, while the block runs; then wipe it.

    Gives a function that says what is waited for from now on. Nothing is shown if the stream is no terminal: a file
    would keep every line."""
    if shown and in_notebook():
        with below_the_cell(what) as tell:
            yield tell
        return
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
    if shown and in_notebook():
        with below_the_cell("") as tell:
            for number, thing in enumerate(things, 1):
                tell(f"{name(thing)}, {number} of {len(things)}")
                yield thing
        return
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(_SECONDS)
    with Progress(*columns, console=console, transient=True, disable=not (shown and console.is_terminal)) as bar:
        task = bar.add_task("", total=len(things))
        for thing in things:
            bar.update(task, description=name(thing))
            yield thing
            bar.advance(task)


def in_notebook() -> bool:
    """Whether the kernel of a notebook runs this; who has not imported IPython is in none."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and getattr(ipython.get_ipython(), "kernel", None) is not None


@contextmanager
def below_the_cell(what: str) -> Iterator[Callable[[str], None]]:
    """The line of `waiting` in a notebook, from the first second on: what takes no longer leaves no trace in it."""
    told, begun, ended = [what], time.monotonic(), threading.Event()
    display = import_module("IPython.display").display

    def count() -> None:
        line = None
        while not ended.wait(TICK):
            text = {"text/plain": f"{told[-1]} ... {time.monotonic() - begun:.0f} s"}
            if line is None:
                line = display(text, raw=True, display_id=True)
            else:
                line.update(text, raw=True)
        if line is not None:
            line.update({"text/plain": "", "text/html": ""}, raw=True)

    # A kernel knows by its context which cell an output belongs to.
    counting = threading.Thread(target=contextvars.copy_context().run, args=(count,), daemon=True)
    counting.start()
    try:
        yield told.append
    finally:
        ended.set()
        counting.join()
