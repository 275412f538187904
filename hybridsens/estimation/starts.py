"""Many starts: each descends by itself, the best of them all is what the fit goes on from."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..validation.arguments import whole_number
from .growing import Growing
from .optimizers import Method
from .problem import FitProblem


class RandomStarts(eqx.Module):
    """So many starting points within +-`spread` of the guess, relatively; the guess itself is the first of them."""

    count: int = 1
    """How many."""
    spread: float = 0.3
    """How far they lie from the guess, relative to it; inside (0, 1)."""
    seed: int = 0
    """Of the random numbers: the same seed gives the same points."""

    def __check_init__(self):
        whole_number("`count`", self.count)
        if not 0 < self.spread < 1:
            raise ValueError(f"`spread` must lie inside (0, 1), but is {self.spread}.")


class Starts(NamedTuple):
    """What became of every start."""

    z: Float[Array, "start unknown"]
    """Where each ended."""
    loss: Float[Array, "start"]
    """inf where the motion fails."""
    iterations: Int[Array, "start"]
    converged: Bool[Array, "start"]


def spread_starts(problem: FitProblem, z, starts: RandomStarts) -> Float[Array, "start unknown"]:
    """Starting points: the guess, and values drawn uniformly around it, inside the bounds."""
    selection = problem.selection
    guess = np.asarray(selection.to_values(z))
    factors = np.random.default_rng(starts.seed).uniform(-starts.spread, starts.spread, (starts.count - 1, guess.size))
    values = guess + factors * np.asarray(selection.scale)
    inside = lambda bound: guess + 0.95 * (bound - guess)
    values = np.clip(values, inside(selection.lower), inside(selection.upper))
    return jnp.stack([z, *(selection.from_values(row) for row in values)])


def descend_from_all(
    method: Method | Growing, problem: FitProblem, zs: Float[Array, "start unknown"], iterations: int,
    tell: Callable[[int, float], None],
) -> tuple[Starts, bool]:  # fmt: skip
    """All starts, and whether Ctrl-C ended them: then those that had finished, of which there is one at least.

    On a CPU they run one after the other, since a batch that waits for its slowest element would do several times the
    work, and `tell` hears of each with its loss; elsewhere all at once.
    """
    if jax.default_backend() != "cpu":
        return _descend_at_once(method, problem, zs, iterations), False
    found: list[Starts] = []
    try:
        for number, z in enumerate(zs, 1):
            found.append(jax.block_until_ready(_descend(method, problem, z, iterations)))
            tell(number, float(found[-1].loss))
    except KeyboardInterrupt:
        if not found:
            raise
    return jax.tree.map(lambda *rows: jnp.stack(rows), *found), len(found) < len(zs)


@eqx.filter_jit
def _descend_at_once(method: Method | Growing, problem: FitProblem, zs, iterations: int) -> Starts:
    return jax.vmap(lambda z: _descend(method, problem, z, iterations))(zs)


class _Running(NamedTuple):
    """One start on its way."""

    carry: Any
    z: Float[Array, "unknown"]
    loss: Float[Array, ""]
    """The best point of the whole problem."""
    tried: Int[Array, ""]
    """Trial points."""
    whole: Int[Array, ""]
    """Those of the whole problem, not of stages before it."""
    ended: Bool[Array, ""]


@eqx.filter_jit
def _descend(method: Method | Growing, problem: FitProblem, z, iterations: int) -> Starts:
    arrays, static = eqx.partition(method.begin(z), eqx.is_array)

    def body(now: _Running) -> _Running:
        carry, outcome, _ = method.step(problem, eqx.combine(now.carry, static))
        better = outcome.accepted & (outcome.loss < now.loss) & ~outcome.trial.failed & ~outcome.in_stage
        z, loss = (jnp.where(better, new, old) for new, old in ((outcome.z, now.z), (outcome.loss, now.loss)))
        whole = now.whole + (~outcome.first & ~outcome.in_stage)
        ended = jnp.asarray(outcome.ends & ~outcome.in_stage)
        return _Running(eqx.filter(carry, eqx.is_array), z, loss, now.tried + ~outcome.first, whole, ended)

    none = jnp.array(0)
    begin = _Running(arrays, z, jnp.asarray(jnp.inf, z.dtype), none, none, jnp.array(False))
    end = lax.while_loop(lambda now: (now.whole < iterations) & ~now.ended, body, begin)
    return Starts(end.z, end.loss, end.tried, end.ended & jnp.isfinite(end.loss))
