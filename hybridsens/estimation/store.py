"""The best point of a fit on disk, so that a fit that was killed goes on from it; and what tells one fit from another:
its measurements, and the numbers of its model that are not fitted."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..export.one_move import in_one_move, must_have_a_folder
from ..validation.caller import warn_caller
from ..validation.program import array_bytes
from .data import Measurements
from .parameters import Selection, check_inside
from .problem import FitProblem


class Kept(NamedTuple):
    """What a store holds of a fit before."""

    values: np.ndarray
    """Of the parameters."""
    starts: int
    """From how many starts they come."""


class Store(NamedTuple):
    """A JSON file with the names and the best values of the fitted parameters, and the digest of their study."""

    path: Path
    selection: Selection
    study: str
    """See `study_digest`."""
    starts: int = 1
    """From how many starts the values come."""

    def write(self, z) -> None:
        """Replace the file in one move, so that it is whole at any time."""
        values = self.selection.to_values(jnp.asarray(z)).tolist()
        by_name = dict(zip(self.selection.labels, values, strict=True))
        kept = {"values": by_name, "study": self.study, "starts": self.starts}
        try:
            with in_one_move(self.path) as draft:
                draft.write_text(json.dumps(kept, indent=2) + "\n")
        except OSError as error:  # the fit itself is worth more
            warn_caller(f"{self.path} cannot be written ({error.strerror}). The fit goes on.")

    def read(self) -> Kept | None:
        """What the file holds; None if there is no file yet.

        Raises: ValueError for a path that cannot be written to, and for a file that holds no values, those of other
        parameters or of another study, or values outside their bounds.
        """
        must_have_a_folder(self.path, "`store` must be the path of a JSON file")
        if not self.path.exists():
            return None
        (saved, study, starts), labels = self._saved(), self.selection.labels
        if tuple(saved) != labels:
            raise ValueError(
                f"`store` must be of the same parameters {labels}, but {self.path} has {tuple(saved)}."
            )
        if study != self.study:
            raise ValueError(
                f"`store` must be of the same study, but {self.path} is of other measurements, another model, other "
                "numbers in it that are not fitted, or another beginning. Remove it, or name another file."
            )
        values = np.array(list(saved.values()), float)
        check_inside(f"value in {self.path}", self.selection, values)
        return Kept(values, starts)

    def _saved(self) -> tuple[dict[str, float], str, int]:
        try:
            saved: Any = json.loads(self.path.read_text())
        except ValueError as error:  # no JSON, or no text
            raise ValueError(f"`store` must be a JSON file, but {self.path} is none: {error}.") from error
        found = saved if isinstance(saved, dict) else {}
        values, study, starts = found.get("values"), found.get("study"), found.get("starts", 1)
        numbers = isinstance(values, dict) and all(map(_is_number, values.values()))
        if numbers and isinstance(study, str) and isinstance(starts, int):
            return cast(dict[str, float], values), study, starts
        raise ValueError(
            f"`store` must be a JSON file of names and numbers that a fit wrote, but {self.path} has "
            f"{str(saved)[:60]}. Remove it, or name another file."
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def study_digest(problem: FitProblem, measured: Measurements) -> str:
    """A digest of the measurements, of the names of the model's classes, of its numbers that are not fitted, of its
    texts and of what is static, of a given initial state and mode, and of t0.

    The guess is not in it, nor bounds, priors and settings: a fit may go on under others. Functions are not compared.
    """
    fixed = jax.tree.leaves(problem.selection.insert(problem.scene, jnp.zeros(len(problem.selection.labels))))
    names = problem.selection.labels, measured.names, tuple(_kinds_and_constants(problem.scene))
    digest = hashlib.sha256(repr(names).encode())
    for leaf in jax.tree.leaves((measured, fixed, problem.start, problem.t0)):
        if _is_numeric(leaf):
            digest.update(array_bytes(np.asarray(leaf)))
    return digest.hexdigest()


def _kinds_and_constants(part: Any) -> Iterator[tuple[str, Any]]:
    """The classes of a model and of its parts, its texts, and names and values of its static fields, those that say
    what they are."""
    if isinstance(part, str):
        yield "text", part
    elif isinstance(part, eqx.Module):
        yield "class", type(part).__qualname__
        for field in dataclasses.fields(part):
            value = getattr(part, field.name, None)
            if not field.metadata.get("static", False):
                yield from _kinds_and_constants(value)
            elif jax.tree.all(jax.tree.map(lambda leaf: isinstance(leaf, int | float | str), value)):
                yield field.name, value
    elif isinstance(part, list | tuple):
        for member in part:
            yield from _kinds_and_constants(member)
    elif isinstance(part, dict):
        yield from _kinds_and_constants(list(part.values()))


def _is_numeric(leaf: Any) -> bool:
    """Whether a leaf is a number or an array of them, and not a function or a random key."""
    return eqx.is_array_like(leaf) and not jnp.issubdtype(getattr(leaf, "dtype", float), jax.dtypes.prng_key)
