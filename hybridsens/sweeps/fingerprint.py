"""What a program is, in a digest: its text and all data that it holds."""

import hashlib
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from .engine import Program, evaluate_once


def program_digest(program: Program, columns: dict[str, np.ndarray]) -> str:
    """A digest of the program of one point as the compiler gets it: the same digest means the same numbers.

    Its text alone is not enough. Arrays of the scene and of the cost are arguments of the program, and so are arrays
    that the cost closes over with `jax_use_simplified_jaxpr_constants`: the text has their shapes only.
    """
    one = {name: jnp.asarray(column[0]) for name, column in columns.items()}
    given = (program.cost, program.scene, program.wanted, one)
    digest = hashlib.sha256(evaluate_once.lower(*given).as_text().encode())
    traced, _, _ = eqx.filter_make_jaxpr(evaluate_once)(*given)
    arguments = filter(_is_array, jax.tree.leaves((program.cost, program.scene)))
    # Each array once, in the order of use: programs differ that hold the same data in other places.
    for array in {id(array): array for array in (*arguments, *_constants(traced))}.values():
        digest.update(_bytes(array))
    return digest.hexdigest()


def _constants(jaxpr: ClosedJaxpr | Jaxpr) -> Iterator[Any]:
    """All arrays that a traced function holds, in the order of the trace; scalars stand in the text."""
    if isinstance(jaxpr, ClosedJaxpr):
        yield from jaxpr.consts
        jaxpr = jaxpr.jaxpr
    for equation in jaxpr.eqns:
        yield from _literals(equation.invars)
        for inner in jax.tree.leaves(equation.params):
            if isinstance(inner, ClosedJaxpr | Jaxpr):
                yield from _constants(inner)
    yield from _literals(jaxpr.outvars)


def _literals(atoms) -> Iterator[Any]:
    return (atom.val for atom in atoms if isinstance(atom, Literal) and np.ndim(atom.val) > 0)


def _is_array(leaf: Any) -> bool:
    return eqx.is_array(leaf) or isinstance(leaf, np.ndarray | np.generic)


def _bytes(array: Any) -> bytes:
    if jnp.issubdtype(array.dtype, jax.dtypes.prng_key):
        array = jax.random.key_data(array)
    return f"{array.dtype} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes()
