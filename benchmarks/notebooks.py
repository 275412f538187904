"""The notebooks: each notebooks/NAME.py is executed and written, with what it shows, to notebooks/NAME.ipynb.

    python -m benchmarks.notebooks [NAME ...]

The sources are the scripts in cells; a notebook is made of them and never edited. Needs the extra `notebooks`.
"""

import sys
import time
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "notebooks"
LONGEST = 1800
"""Seconds for one cell."""


def make(source: Path) -> Path:
    """Execute one source. Returns: the notebook's path. Raises: CellExecutionError where a cell fails."""
    notebook = jupytext.read(source)
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    )
    NotebookClient(notebook, timeout=LONGEST, resources={"metadata": {"path": str(FOLDER)}}).execute()
    for number, cell in enumerate(notebook.cells):
        cell.id = str(number)  # the same at every run, so that a comparison of two versions shows what has changed
        cell.metadata = {}
        for output in cell.get("outputs", []):
            output.get("metadata", {}).clear()
    notebook.metadata.pop("language_info", None)  # the version of whoever ran it
    path = source.with_suffix(".ipynb")
    nbformat.write(notebook, path)
    return path


def main(names: list[str]) -> None:
    """All of them, or those named."""
    for source in [FOLDER / f"{name}.py" for name in names] or sorted(FOLDER.glob("*.py")):
        begin = time.perf_counter()
        path = make(source)
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB, {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
