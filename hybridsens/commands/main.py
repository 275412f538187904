"""The `hybridsens` command."""

import sys
from importlib.metadata import version
from typing import Annotated

import typer

from ..configure import configure
from ..trajectory import SimulationError
from .demo import demo
from .scenes import scenes

app = typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode=None, help="Hybrid motions and their exact gradients.")

# Every command, in the order in which `hybridsens --help` lists them.
for command in (demo, scenes):
    app.command()(command)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(version("hybridsens"))
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")] = False,
) -> None:
    del version


def run(arguments: list[str] | None = None) -> int:
    """Run a command line; an error that the user can mend is one line on the error stream. Returns the exit status."""
    try:
        return app(arguments, standalone_mode=False) or 0
    except (typer.TyperException, SimulationError, ValueError) as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        print(f"hybridsens: {' '.join(message.split())}", file=sys.stderr)
        return getattr(error, "exit_code", 1)


def main() -> None:
    """Entry point of the console script. JAX reads its settings when it starts, so they are made before any command."""
    configure()
    sys.exit(run())
