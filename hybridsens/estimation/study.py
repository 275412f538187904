"""What tells one fit from another: its measurements, and the numbers of its model that are not fitted."""

import hashlib
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .data import Measurements
from .problem import Problem


def study_digest(problem: Problem, measured: Measurements) -> str:
    """A digest of the measurements, of the name of the model's class, of its numbers that are not fitted, of a given
    initial state and mode, and of t0.

    The guess is not in it, nor bounds, priors and settings: a fit may go on under others. Functions are not compared.
    """
    fitted = set(problem.selection.positions)
    fixed = [leaf for place, leaf in enumerate(jax.tree.leaves(problem.scene)) if place not in fitted]
    digest = hashlib.sha256(repr((type(problem.scene).__qualname__, problem.selection.labels, measured.names)).encode())
    for leaf in jax.tree.leaves((measured, fixed, problem.start, problem.t0)):
        if _is_number(leaf):
            array = np.asarray(leaf)
            digest.update(f"{array.dtype} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _is_number(leaf: Any) -> bool:
    """Whether a leaf is a number or an array of them, and not a function or a random key."""
    return eqx.is_array_like(leaf) and not jnp.issubdtype(getattr(leaf, "dtype", float), jax.dtypes.prng_key)
