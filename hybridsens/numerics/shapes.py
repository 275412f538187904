"""A PyTree of real arrays as one vector, and back."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Shapes(NamedTuple):
    """The structure of a PyTree of real arrays."""

    tree: Any
    shapes: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, tree: Any) -> "Shapes":
        leaves, structure = jax.tree.flatten(tree)
        return cls(structure, tuple(np.shape(leaf) for leaf in leaves))

    @property
    def size(self) -> int:
        return sum(int(np.prod(shape)) for shape in self.shapes)

    def flatten(self, tree: Any, dtype) -> Float[Array, "entry"]:
        """All entries in one vector."""
        parts = [jnp.ravel(leaf).astype(dtype) for leaf in jax.tree.leaves(tree)]
        return jnp.concatenate([jnp.zeros(0, dtype), *parts])

    def restore(self, vector: Float[Array, "*batch entry"]) -> Any:
        """The PyTree of a vector; leading axes are kept."""
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in self.shapes)])
        # Slices, not `jnp.split`: interval arithmetic has no rule for that, so every guard would have to be sampled.
        parts = [vector[..., begin:end] for begin, end in zip(ends[:-1], ends[1:], strict=True)]
        batch = vector.shape[:-1]
        return self.tree.unflatten([p.reshape(batch + shape) for p, shape in zip(parts, self.shapes, strict=True)])
