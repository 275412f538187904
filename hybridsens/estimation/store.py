"""The best point of a fit on disk, so that a fit that was killed goes on from it."""

import json
import os
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from .parameters import Selection


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

        Raises: ValueError for a file of other parameters.
        """
        if not self.path.exists():
            return None
        saved = json.loads(self.path.read_text())
        if tuple(saved) != self.selection.labels:
            raise ValueError(
                f"`store` must be of the same parameters {self.selection.labels}, but {self.path} has "
                f"{tuple(saved)}."
            )
        return np.array(list(saved.values()))
