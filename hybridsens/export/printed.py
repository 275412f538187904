"""A module as it prints, with the numbers of its small arrays."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import numpy as np

SMALL = 12
"""Arrays of up to so many numbers are printed in full; larger ones as their type and shape."""


class Numbers:
    """What stands for an array while a module is printed."""

    def __init__(self, text: str):
        self.text = text

    def __repr__(self) -> str:
        return self.text


def printed(module: eqx.Module) -> str:
    """A module with its fields, `Ball(weight=9.81, e=0.8)`: a gradient is one too, and its numbers are what matters."""
    return eqx.tree_pformat(jax.tree.map(_with_numbers, module), width=80)


def _with_numbers(leaf: Any) -> Any:
    if isinstance(leaf, jax.core.Tracer) or not isinstance(leaf, jax.Array | np.ndarray) or leaf.size > SMALL:
        return leaf
    text = np.array2string(np.asarray(leaf), precision=6, separator=", ", max_line_width=1000)
    return Numbers(" ".join(text.split()))
