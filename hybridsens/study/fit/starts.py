"""Many starts in one compiled run: each descends by itself, the best of them all is what the fit goes on from."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .horizon import GrowingHorizon
from .optimizers import Method
from .problem import Problem


class Starts(NamedTuple):
    """What became of every start."""

    z: Float[Array, "start unknown"]
    """Where each ended."""
    loss: Float[Array, "start"]
    """inf where the motion fails."""
    iterations: Int[Array, "start"]
    converged: Bool[Array, "start"]


def spread_starts(problem: Problem, z, count: int, spread: float, seed: int) -> Float[Array, "start unknown"]:
    """Starting points: the guess, and values drawn uniformly within +-spread of it, relatively, inside the bounds.

    Raises: ValueError for a count below 1 or a spread outside (0, 1).
    """
    if count < 1 or not 0 < spread < 1:
        raise ValueError(f"`starts` must be >= 1 and `spread` inside (0, 1), but they are {count} and {spread}.")
    selection = problem.selection
    guess = np.asarray(selection.to_values(z))
    factors = np.random.default_rng(seed).uniform(-spread, spread, (count - 1, guess.size))
    values = guess + factors * np.asarray(selection.scale)
    inside = lambda bound: guess + 0.95 * (bound - guess)
    values = np.clip(values, inside(selection.lower), inside(selection.upper))
    return jnp.stack([z, *(selection.from_values(row) for row in values)])


@eqx.filter_jit
def descend_from_all(
    method: Method, problem: Problem, zs: Float[Array, "start unknown"], growth: GrowingHorizon | None, iterations: int
) -> Starts:
    """All starts in one compiled call: on a CPU one after the other, elsewhere all at once.

    On a CPU a batch that waits for its slowest lane would do several times the work.
    """

    def lane(z):
        z = z if growth is None else _grow(method, problem, growth, z)
        return _descend(method, problem, z, iterations)

    return lax.map(lane, zs) if jax.default_backend() == "cpu" else jax.vmap(lane)(zs)


def _grow(method: Method, problem: Problem, growth: GrowingHorizon, z):
    def one_stage(loop):
        at, end = loop
        at = _descend(method, growth.stage(problem, z, end), at, growth.trials, growth.steps).z
        return at, growth.next(problem, at, end)

    return lax.while_loop(lambda loop: loop[1] < problem.horizon, one_stage, (z, growth.begin(problem, z)))[0]


def _descend(method: Method, problem: Problem, z, iterations: int, accepted: float = jnp.inf) -> Starts:
    carry = method.begin(z)
    arrays, static = eqx.partition(carry, eqx.is_array)

    def go_on(loop):
        _, count, taken, done, _, _ = loop
        return (count <= iterations) & (taken < accepted) & ~done

    def body(loop):
        arrays, count, taken, _, best_z, best = loop
        carry = eqx.combine(arrays, static)
        first = method.begins(carry)
        carry, outcome, _ = method.step(problem, carry)
        better = outcome.accepted & (outcome.loss < best) & ~outcome.trial.failed
        best_z, best = jnp.where(better, outcome.z, best_z), jnp.where(better, outcome.loss, best)
        done = ((outcome.converged | outcome.stalled) & ~first) | (first & outcome.trial.failed)
        return eqx.filter(carry, eqx.is_array), count + 1, taken + (outcome.accepted & ~first), done, best_z, best

    begin = (arrays, jnp.array(0), jnp.array(0), jnp.array(False), z, jnp.asarray(jnp.inf, z.dtype))
    _, count, _, done, z, loss = lax.while_loop(go_on, body, begin)
    return Starts(z, loss, count - 1, done & jnp.isfinite(loss))
