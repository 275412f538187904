"""Rows of a benchmark: shown as they are made, written with the machine and the versions beside them."""

import csv
from pathlib import Path

from .machine import describe

FOLDER = Path(__file__).parents[1] / "results"


def show(row: dict) -> dict:
    """Print a row, numbers to three digits."""
    texts = (f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}" for name, value in row.items())
    print("  ".join(texts), flush=True)
    return row


def write(name: str, rows: list[dict]) -> None:
    """Write rows to results/`name`.csv; a column that a row lacks stays empty."""
    FOLDER.mkdir(exist_ok=True)
    rows = [{**row, **describe()} for row in rows]
    with (FOLDER / f"{name}.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, list(dict.fromkeys(column for row in rows for column in row)))
        table.writeheader()
        table.writerows(rows)
