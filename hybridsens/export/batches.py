"""Batches of motions: parts of them, and what a table or a data set of all of them is made of."""

import math
from collections.abc import Callable
from typing import Any, TypeVar

import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .datasets import optional

Motion = TypeVar("Motion")


def part_of(batch: Motion, index: Any) -> Motion:
    """The motions of a batch at `index`, as of an array: one for a number, a batch for a slice, a list or a mask.

    Raises: TypeError for one motion; IndexError outside of the batch, where JAX would take the last."""
    shape = np.shape(batch.events.count)  # type: ignore[attr-defined]
    axes = len(shape)
    if not shape:
        raise TypeError(
            f"An index must be that of a batch of motions, but this {type(batch).__name__} is one: its samples and "
            "events are arrays with an index each."
        )
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(index))
    runs = math.prod(shape)
    number = (jnp if traced else np).arange(runs).reshape(shape)
    # The index is that of the batch's axes alone: in a leaf itself `...` would reach through to its last axis.
    chosen = number[index]
    return jax.tree.map(lambda leaf: jnp.asarray(leaf).reshape(runs, *leaf.shape[axes:])[chosen], batch)


def must_be_known(count, wanted_by: str) -> None:
    """Raise ValueError inside of a transformation of JAX, where numbers are not known yet."""
    if isinstance(count, jax.core.Tracer):
        raise ValueError(f"{wanted_by} must be called outside of jax.jit, jax.grad and jax.vmap, on what they return.")


def must_be_one(count, wanted_by: str) -> None:
    """Raise ValueError for a batch of motions, or one whose numbers are not known yet."""
    must_be_known(count, wanted_by)
    if np.ndim(count) > 0:
        raise ValueError(
            f"{wanted_by} must be called on one motion, but this is a batch of {np.shape(count)}: take one of it by "
            "`batch[i]`."
        )


def leading(count, wanted_by: str) -> tuple[str, ...]:
    """The dimensions in front of all others in a data set: none for one motion, `run` for a batch.

    Raises: ValueError for a batch of several axes, or none, or inside of a transformation."""
    must_be_known(count, wanted_by)
    if np.ndim(count) > 1 or np.size(count) == 0:
        raise ValueError(
            f"{wanted_by} must be called on one motion, or on a batch of at least one along one axis, but this is a "
            f"batch of {np.shape(count)}: a part of it is `batch[i]`."
        )
    return ("run",) * np.ndim(count)


def happened(events: Any) -> Any:
    """The rows of the events that there were; of a batch as many of each motion as one of them had at most."""
    axes, most = np.ndim(events.count), int(np.max(events.count))
    rows = lambda leaf: np.asarray(leaf)[(slice(None),) * axes + (slice(most),)]
    return jax.tree.map(lambda leaf: rows(leaf) if np.ndim(leaf) > axes else np.asarray(leaf), events)


def of_each_run(motions: Any, count, table: Callable[[Any], Any]):
    """The pandas tables of all motions in a batch below each other, with an index whose first level is `run`."""
    leading(count, "to_pandas()")
    pandas = optional("pandas", "to_pandas()")
    on_host = jax.tree.map(np.asarray, motions)
    tables = [table(jax.tree.map(lambda leaf, run=run: leaf[run], on_host)) for run in range(count.size)]
    return pandas.concat(tables, keys=range(len(tables)), names=["run", tables[0].index.name])
