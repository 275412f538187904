"""The `hybridsens` command."""

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer

from ..configure import configure
from ..outcome import SimulationError
from ..validation.spelling import did_you_mean
from .demo import demo
from .fit import fit
from .gradients import check, compare, work_precision
from .help_texts import SHORT, epilog
from .models import FILE
from .scenes import scenes
from .sweep import sweep

MISTAKE = 2
"""Exit status where what was asked for cannot be."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""
PACKAGE = Path(__file__).parent.parent
"""Of this package: its own TypeErrors say all that is to be said."""

app = typer.Typer(rich_markup_mode=None)

COMMANDS = {
    command.__name__.replace("_", "-"): command
    for command in (demo, scenes, check, compare, work_precision, fit, sweep)
}
"""Every command, in the order in which `hybridsens --help` lists them."""
for name, command in COMMANDS.items():
    app.command(name, short_help=SHORT[name], epilog=epilog(name))(command)


def _print_version(wanted: bool) -> bool:
    if wanted:
        print(version("hybridsens"))
        raise typer.Exit
    return wanted


@app.callback()
def _hybridsens(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Hybrid mechanical motions and their exact gradients. `hybridsens COMMAND --help` has examples."""
    del show_version


def run(arguments: list[str] | None = None) -> int:
    """Run a command line; an error that the user can mend is one line on the error stream. Returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        _must_be_known(arguments)
        return app(arguments or ["--help"], prog_name="hybridsens", standalone_mode=False) or 0
    except (typer.TyperException, SimulationError, ValueError, TypeError, OSError, ImportError) as error:
        where, inner = _where(error), traceback.extract_tb(error.__traceback__)[-1]
        if isinstance(error, TypeError) and not (where or Path(inner.filename).is_relative_to(PACKAGE)):
            raise  # what a library says needs the lines that led there
        notes = [note for note in getattr(error, "__notes__", []) if not note.startswith("---")]  # JAX's on its frames
        message = " ".join([getattr(error, "format_message", error.__str__)(), *notes])
        print(f"hybridsens: {' '.join(message.split())}{where}", file=sys.stderr)
        return getattr(error, "exit_code", 1 if isinstance(error, SimulationError) else MISTAKE)


def _where(error: BaseException) -> str:
    """The innermost line of the user's own file that led to it; empty where none did."""
    lines = reversed(list(traceback.walk_tb(error.__traceback__)))
    own = ((frame.f_code, line) for frame, line in lines if frame.f_globals.get("__name__", "").startswith(FILE))
    return next((f" ({Path(code.co_filename).name}, line {line}, in {code.co_name})" for code, line in own), "")


def _must_be_known(arguments: list[str]) -> None:
    """Raises: typer.BadParameter for a first word that is no command; what begins with a dash is an option."""
    name = arguments[0] if arguments else "--help"
    if not name.startswith("-") and name not in COMMANDS:
        raise typer.BadParameter(
            f"there is no command {name!r}; choose {', '.join(COMMANDS)}.{did_you_mean(name, COMMANDS)}"
        )


def main() -> None:
    """Entry point of the console script. JAX reads its settings when it starts, so they are made before any command.
    Compiled programs are kept, so that the same command starts quickly the next time."""
    interrupted = threading.Event()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # a job in the background ignores Ctrl-C
        signal.signal(signal.SIGINT, _interrupt(interrupted))
    try:
        configure(cache=True)
        status = run()
    except KeyboardInterrupt:
        status = INTERRUPTED
    if not interrupted.is_set():
        sys.exit(status)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends in any case
    if status == INTERRUPTED:
        print("hybridsens: interrupted", file=sys.stderr)
    # JAX crashes where Python takes down what was interrupted while it compiled, so leave without taking down.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def _interrupt(interrupted: threading.Event) -> Callable[[int, FrameType | None], None]:
    """What Ctrl-C does: it ends the command, wherever that is.

    Python swallows what is raised while it collects garbage, so there Ctrl-C comes again a moment later."""

    def handle(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        if frame is not None and frame.f_code.co_name == "_xla_gc_callback":
            threading.Timer(0.05, os.kill, (os.getpid(), number)).start()
            return
        signal.default_int_handler(number, frame)

    return handle
