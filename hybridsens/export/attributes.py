"""What the data sets of all motions share: how the motion ended, and the outline from which a file is read back."""

import json
from typing import Any

import jax
import jax.core
import numpy as np

from .trees import structure


def attributes(kind: str, motion: Any) -> dict[str, Any]:
    """Attributes of a data set: what it holds, status, work, room for events."""
    return {
        "hybridsens": kind,
        "status": motion.status.message or "successful",
        "status_code": int(motion.status.code),
        "steps_accepted": int(motion.steps.accepted),
        "steps_rejected": int(motion.steps.rejected),
        "max_events": motion.events.time.shape[0],
    }


def with_structure(dataset, **trees: Any):
    """The dataset with the outlines of trees, from which a file is read back.

    Raises: TypeError for a tree that a file cannot hold."""
    return dataset.assign_attrs(
        {f"{name}_structure": json.dumps(structure(name, tree)) for name, tree in trees.items()}
    )


def must_be_one(count, wanted_by: str) -> None:
    """Raise ValueError for a batch of motions, or one whose numbers are not known yet."""
    if isinstance(count, jax.core.Tracer):
        raise ValueError(f"{wanted_by} must be called outside of jax.jit, jax.grad and jax.vmap, on what they return.")
    if np.ndim(count) > 0:
        raise ValueError(
            f"{wanted_by} must be called on one motion, but this is a batch of {np.shape(count)}: take one of it by "
            "jax.tree.map(lambda leaf: leaf[i], batch)."
        )
