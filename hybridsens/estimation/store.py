"""The best point of a fit on disk, so that a fit that was killed goes on from it."""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .parameters import Selection, check_inside


class Store(NamedTuple):
    """A JSON file with the names and the best values of the fitted parameters."""

    path: Path
    selection: Selection

    def write(self, z) -> None:
        """Replace the file in one move, so that it is whole at any time; unknowns after the parameters are left out."""
        labels = self.selection.labels
        values = np.asarray(self.selection.to_values(jnp.asarray(z[: len(labels)])))
        draft = self.path.with_name(self.path.name + ".part")
        draft.write_text(json.dumps(dict(zip(labels, values.tolist(), strict=True)), indent=2) + "\n")
        os.replace(draft, self.path)

    def read(self) -> np.ndarray | None:
        """Values of the parameters; None if there is no file yet.

        Raises: ValueError for a path that cannot be written to, and for a file that holds no values, those of other
        parameters, or values outside their bounds.
        """
        if self.path.is_dir() or not self.path.parent.is_dir():
            what = "is a folder" if self.path.is_dir() else "is in a folder that does not exist"
            raise ValueError(f"`store` must be the path of a JSON file in a folder that exists, but {self.path} "
                             f"{what}.")  # fmt: skip
        if not self.path.exists():
            return None
        saved, labels = self._saved(), self.selection.labels
        if tuple(saved) != labels:
            raise ValueError(
                f"`store` must be of the same parameters {labels}, but {self.path} has {tuple(saved)}."
            )
        values = np.array(list(saved.values()), float)
        check_inside(f"value in {self.path}", self.selection, values)
        return values

    def _saved(self) -> dict[str, float]:
        try:
            saved: Any = json.loads(self.path.read_text())
        except ValueError as error:  # no JSON, or no text
            raise ValueError(f"`store` must be a JSON file, but {self.path} is none: {error}.") from error
        values = saved.values() if isinstance(saved, dict) else [None]
        if not all(isinstance(value, int | float) for value in values):
            raise ValueError(
                f"`store` must be a JSON file of names and numbers, but {self.path} has {str(saved)[:60]}. Remove "
                "it, or name another file."
            )
        return saved
