"""The `hybridsens` command."""

import sys
from importlib.metadata import version
from typing import Annotated

import typer

from ..configure import configure
from ..outcome import SimulationError
from .check import check
from .compare import compare
from .demo import demo
from .fit import fit
from .help_texts import SHORT, epilog
from .scenes import scenes
from .sweep import sweep
from .work_precision import work_precision

app = typer.Typer(rich_markup_mode=None)

# Every command, in the order in which `hybridsens --help` lists them.
for command in (demo, scenes, check, compare, work_precision, fit, sweep):
    name = command.__name__.replace("_", "-")
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
        return app(arguments or ["--help"], prog_name="hybridsens", standalone_mode=False) or 0
    except (typer.TyperException, SimulationError, ValueError, OSError, ImportError) as error:
        message = getattr(error, "format_message", error.__str__)()
        print(f"hybridsens: {' '.join(message.split())}", file=sys.stderr)
        return getattr(error, "exit_code", 1)


def main() -> None:
    """Entry point of the console script. JAX reads its settings when it starts, so they are made before any command.
    Compiled programs are kept, so that the same command starts quickly the next time."""
    configure(cache=True)
    sys.exit(run())
