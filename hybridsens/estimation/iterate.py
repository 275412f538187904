"""Several iterations of an optimizer in one compiled call: on short motions the calls themselves cost the most."""

import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from .growing import Growing
from .optimizers import Method
from .problem import Outcome

MOST = 32
"""At most so many iterations in one call."""
_SECONDS = 0.1


class Iterations(NamedTuple):
    """What one call did."""

    carry: Any
    """The optimizer's state after it."""
    outcomes: list[Outcome]
    """One for each iteration, on the host."""
    linearised: Any
    """Residuals and Jacobian at the last trial point; None for an optimizer that has none."""


class BatchSize:
    """How many iterations one call makes: as many as a tenth of a second holds, so that Ctrl-C is heard."""

    def __init__(self, most: int = MOST):
        self.limit, self.most = 1, most

    def run(self, method: Method | Growing, problem, carry, room: int) -> Iterations:
        """Some iterations, at most `room` of them on the whole problem; fewer if the optimizer ends before."""
        begin = time.perf_counter()
        done = iterate(method, problem, carry, self.limit, room)
        each = (time.perf_counter() - begin) / len(done.outcomes)
        self.limit = int(np.clip(_SECONDS / each, 1, self.most))
        return done


def iterate(method: Method | Growing, problem, carry, limit: int, room: int) -> Iterations:
    """At most `limit` iterations, at most `room` of them on the whole problem; fewer if the optimizer ends before."""
    # What comes back has types of its own; a number that began with the type of its neighbours would compile twice.
    carry = jax.tree.map(lambda leaf: leaf.astype(leaf.dtype) if eqx.is_array(leaf) else leaf, carry)
    carry, rows, count, linearised = _iterate(method, problem, carry, np.asarray(min(limit, MOST)), np.asarray(room))
    leaves, tree = jax.tree.flatten(jax.tree.map(np.asarray, rows))
    outcomes = [tree.unflatten([leaf[i] for leaf in leaves]) for i in range(int(count))]
    return Iterations(carry, outcomes, linearised)


@eqx.filter_jit
def _iterate(method: Method | Growing, problem, carry, limit, room):
    arrays, static = eqx.partition(carry, eqx.is_array)

    def step(arrays):
        carry, outcome, linearised = method.step(problem, eqx.combine(arrays, static))
        return eqx.filter(carry, eqx.is_array), jax.tree.map(jnp.asarray, outcome), linearised

    def go_on(loop):
        _, _, _, count, whole, ended = loop
        return (count < limit) & (whole < room) & ~ended

    def body(loop):
        arrays, rows, _, count, whole, _ = loop
        arrays, outcome, linearised = step(arrays)
        rows = jax.tree.map(lambda rows, row: rows.at[count].set(row), rows, outcome)
        return arrays, rows, linearised, count + 1, whole + ~outcome.in_stage, outcome.ends & ~outcome.in_stage

    _, outcome, linearised = jax.eval_shape(step, arrays)
    rows = jax.tree.map(lambda s: jnp.zeros((MOST, *s.shape), s.dtype), outcome)
    nothing = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), linearised)
    start = (arrays, rows, nothing, jnp.array(0), jnp.array(0), jnp.array(False))
    arrays, rows, linearised, count, _, _ = lax.while_loop(go_on, body, start)
    return eqx.combine(arrays, static), rows, count, linearised
