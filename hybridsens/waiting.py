"""What is computed, and for how long: a line that counts on a terminal or in a notebook; elsewhere a line a minute."""

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
FIRST_LINE, NEXT_LINE = 15.0, 60.0
"""Seconds until the first line in a file or a pipe, which keeps every line, and from one to the next."""
_SECONDS = "{task.elapsed:.0f} s"


@contextmanager
def waiting(what: str, shown: bool) -> Iterator[Callable[[str], None]]:
    """Show "compiling ... 12 s" on the error stream, or below a notebook's cell, while the block runs; then wipe it.

    Gives a function that says what is waited for from now on. Where nothing can be wiped, see `lines`."""
    if not shown:
        yield lambda what: None
        return
    if in_notebook() or not on_terminal():
        with lines(what) as tell:
            yield tell
        return
    columns = TextColumn("{task.description} ..."), TextColumn(_SECONDS)
    with Progress(*columns, console=Console(stderr=True), transient=True) as line:
        task = line.add_task(what)
        yield lambda what: line.update(task, description=what)


def counted(things: Iterable[Any], name: Callable[[Any], str], shown: bool) -> Iterator[Any]:
    """The things one after the other, with a bar that names the present one, and the time elapsed."""
    things = list(things)
    if not shown:
        yield from things
        return
    if in_notebook() or not on_terminal():
        with lines("") as tell:
            for number, thing in enumerate(things, 1):
                tell(f"{name(thing)}, {number} of {len(things)}")
                yield thing
        return
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(_SECONDS)
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=len(things))
        for thing in things:
            bar.update(task, description=name(thing))
            yield thing
            bar.advance(task)


def in_notebook() -> bool:
    """Whether the kernel of a notebook runs this; who has not imported IPython is in none."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and getattr(ipython.get_ipython(), "kernel", None) is not None


def on_terminal() -> bool:
    """Whether the error stream can change a line that it shows."""
    return Console(stderr=True).is_terminal


@contextmanager
def lines(what: str) -> Iterator[Callable[[str], None]]:
    """The line of `waiting` where Rich has none: below the cell of a notebook, or on a stream that keeps its lines.

    The former counts from the first second on, and what takes no longer leaves no trace in it; the latter has a line
    after `FIRST_LINE` and then after every `NEXT_LINE` seconds, so that whoever reads a log knows that work goes on.
    """
    show, first, tick, wipe = _below_the_cell() if in_notebook() else _on_a_stream()
    told, begun, ended = [what], time.monotonic(), threading.Event()

    def count() -> None:
        pause = first
        while not ended.wait(pause):
            show(f"{told[-1]} ... {time.monotonic() - begun:.0f} s")
            pause = tick
        wipe()

    # A kernel knows by its context which cell an output belongs to.
    counting = threading.Thread(target=contextvars.copy_context().run, args=(count,), daemon=True)
    counting.start()
    try:
        yield told.append
    finally:
        ended.set()
        counting.join()


def _below_the_cell():
    """How to show a line in a notebook, the seconds until the first one and the next, and how to wipe it."""
    display, shown = import_module("IPython.display").display, []

    def show(text: str) -> None:
        if shown:
            shown[0].update({"text/plain": text}, raw=True)
        else:
            shown.append(display({"text/plain": text}, raw=True, display_id=True))

    def wipe() -> None:
        if shown:
            shown[0].update({"text/plain": "", "text/html": ""}, raw=True)

    return show, TICK, TICK, wipe


def _on_a_stream():
    """The same for the error stream, whose lines stay."""
    stream = sys.stderr
    return (lambda text: print(text, file=stream, flush=True)), FIRST_LINE, NEXT_LINE, lambda: None
