"""Names a parameter or an initial value that is not finite."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import numpy as np


def not_finite_among(model: Any, state: Any) -> str:
    """A sentence that names the first parameter of a model which is nan, or the first entry of its initial state which
    is not finite; "" if none is, and while values are traced. An infinite parameter may be meant: a time that never
    comes."""
    is_infinite = lambda leaf: ~np.isfinite(leaf)
    for tree, of, is_wrong in ((model, type(model).__name__, np.isnan), (state, "the initial state", is_infinite)):
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree):
            if isinstance(leaf, jax.core.Tracer):
                return ""
            wrong = np.argwhere(is_wrong(leaf) if eqx.is_inexact_array_like(leaf) else np.array(False))
            if len(wrong):
                index = tuple(wrong[0].tolist())
                return f"{_entry(path, index)} of {of} is {np.asarray(leaf)[index]}."
    return ""


def _entry(path, index: tuple[int, ...]) -> str:
    name = jax.tree_util.keystr(path, simple=True, separator=".") or "value"
    return f"{name}[{', '.join(map(str, index))}]" if index else name
