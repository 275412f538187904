"""The linear complementarity problem that stands for Gauss's principle (T2) and for the impact law (T3)."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..precision import closeness
from ..short import all_of, product
from .dense import solve_masked


def complementarity_support(
    matrix: Float[Array, "n n"],
    vector: Float[Array, "n"],
    candidates: Bool[Array, "n"],
    noise: Float[Array, "n"],
) -> Bool[Array, "n"]:
    """The index set S of the positive unknowns in

        0 <= x _|_ W x + b >= 0   on the candidates, x = 0 elsewhere,   W = W^T >= 0.

    Active sets in the manner of Lawson and Hanson (1974, ch. 23), for the problem's quadratic programme: take in
    the candidate that is violated most, solve with equality on S, and let go what would turn negative. A column that
    depends on those of S is never taken in: so W_SS is regular even where W is singular, and a problem without a
    solution (two walls that close on a body) ends with a set that is regular. `noise` is how large a residual
    rounding alone can make. Nothing here is differentiated: S is piecewise constant, and x_S = -W_SS^-1 b_S is solved
    again where its derivative is wanted.
    """
    matrix, vector, noise = lax.stop_gradient((matrix, vector, noise))
    if vector.shape[0] == 0:
        return candidates
    if vector.shape[0] == 1:
        return candidates & (vector < -noise)

    def take_in(S, x):
        residual = product(matrix, x) + vector
        violation = jnp.where(candidates & ~S & _independent(matrix, S), residual + noise, jnp.inf)
        worst = jnp.argmin(violation)
        finished = violation[worst] >= 0
        return jnp.where(finished, S, S.at[worst].set(True)), finished

    def let_go(S, x, target):
        negative = S & (target <= 0)
        fraction = jnp.where(negative, x / jnp.where(negative, x - target, 1), jnp.inf)
        step = jnp.min(fraction)
        x = x + step * (target - x)
        S = S & ~(negative & (fraction <= step))
        return S, jnp.where(S, x, 0)

    def body(carry):
        S, x, _, count = carry
        target = solve_masked(matrix, -vector, S.astype(vector.dtype))
        feasible = all_of(~S | (target > 0))
        S_out, x_out = let_go(S, x, target)
        S_in, finished = take_in(S, target)
        S_next = jnp.where(feasible, S_in, S_out)
        return S_next, jnp.where(feasible, target, x_out), feasible & finished, count + 1

    def unfinished(carry):
        return ~carry[2] & (carry[3] < 4 * vector.shape[0] + 4)

    start = (jnp.zeros_like(candidates), jnp.zeros_like(vector), jnp.array(False), 0)
    return lax.while_loop(unfinished, body, jax.tree.map(jnp.asarray, start))[0]


def independent_superset(
    matrix: Float[Array, "n n"], S: Bool[Array, "n"], candidates: Bool[Array, "n"]
) -> Bool[Array, "n"]:
    """S and as many of the candidates as W keeps regular: what rests on three feet rests on the fourth."""
    matrix = lax.stop_gradient(matrix)
    take = lambda i, S: S.at[i].set(S[i] | (candidates[i] & _independent(matrix, S)[i]))
    return lax.fori_loop(0, S.shape[0], take, S)


def _independent(matrix, S):
    """Columns that do not depend on those of S: what is left of the diagonal of W when S is eliminated."""
    members = S.astype(matrix.dtype)
    explained = jax.vmap(lambda column: column @ solve_masked(matrix, column, members), in_axes=1)(matrix)
    diagonal = jnp.diag(matrix)
    return diagonal - explained > closeness(matrix.dtype) * diagonal
