"""`hybridsens scenes`: what there is to run."""

import inspect

from rich.console import Console
from rich.table import Table


def scenes() -> None:
    """List the ready-made scenes."""
    from ..scenes import SCENES

    table = Table.grid(padding=(0, 2))
    for name, scene in SCENES.items():
        table.add_row(name, _first_line(inspect.getmodule(scene)))
    Console(soft_wrap=True).print(table)


def _first_line(module) -> str:
    return (module.__doc__ or "").partition("\n")[0]
