"""A motion that is not finite: was a nan given to it?"""

from typing import Any

import equinox as eqx
import jax
import jax.core
import numpy as np


def nan_among(model: Any, state: Any) -> str:
    """A sentence that names the first parameter of a model which is nan, or the first such entry of its initial state;
    "" if none is, and while values are traced."""
    for tree, of in ((model, type(model).__name__), (state, "the initial state")):
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            if isinstance(leaf, jax.core.Tracer):
                return ""
            wrong = np.argwhere(np.isnan(leaf) if eqx.is_inexact_array_like(leaf) else np.array(False))
            if len(wrong):
                return f"{_entry(path, tuple(wrong[0].tolist()))} of {of} is nan."
    return ""


def _entry(path, index: tuple[int, ...]) -> str:
    name = jax.tree_util.keystr(path, simple=True, separator=".") or "value"
    return f"{name}[{', '.join(map(str, index))}]" if index else name
