"""The linear complementarity problem that stands for Gauss's principle (T2) and for the impact law (T3)."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..numerics.dense import pivoted_on, principal_pivot
from ..numerics.tolerances import closeness


class _Search(NamedTuple):
    """Where the search for S stands."""

    tableau: Float[Array, "n columns"]
    """(W, b), pivoted on S."""
    S: Bool[Array, "n"]
    x: Float[Array, "n"]
    """The last point with x >= 0."""
    finished: Bool[Array, ""]
    count: Int[Array, ""]


def complementarity_support(
    matrix: Float[Array, "n n"],
    vector: Float[Array, "n"],
    candidates: Bool[Array, "n"],
    noise: Float[Array, "n"],
) -> Bool[Array, "n"]:
    """The index set S of the positive unknowns in

        0 <= x _|_ W x + b >= 0   on the candidates, x = 0 elsewhere,   W = W^T >= 0.

    Active sets in the manner of Lawson and Hanson (1974, ch. 23), for the problem's quadratic programme: take in the
    candidate that is violated most, solve with equality on S, and drop the first unknown that comes to zero on the way.
    One tableau is kept: it holds x_S, the residual, and on its diagonal the Schur complement of W_SS. To take a contact
    in is a principal pivot, O(n^2); to drop one builds the tableau anew. A column that depends on those of S is never
    taken in: so W_SS is regular even where W is singular, and a problem without a solution (two walls that close on a
    body) ends with a set that is regular.
    `noise` is how large a residual rounding alone can make. Nothing here is differentiated: S is piecewise constant,
    and x_S = -W_SS^-1 b_S is solved again where its derivative is wanted.
    """
    matrix, vector, noise = lax.stop_gradient((matrix, vector, noise))
    n = vector.shape[0]
    if n == 0:
        return candidates
    if n == 1:
        return candidates & (vector < -noise)
    if n == 2:
        return _support_of_two(matrix, vector, candidates, noise)
    least = closeness(matrix.dtype) * jnp.diag(matrix)

    def turn(carry: _Search):
        T, S, x, _, count = carry
        value, left = T[:, n], jnp.diagonal(T)  # of members: x; of the others: residual, and what is left of W
        negative = S & (value <= 0)
        feasible = ~jnp.any(negative)
        violation = jnp.where(candidates & ~S & (left > least), value + noise, jnp.inf)
        target = jnp.where(S, value, 0)
        fraction = jnp.where(negative, x / jnp.where(negative, x - target, 1), jnp.inf)
        k = jnp.where(feasible, jnp.argmin(violation), jnp.argmin(fraction))
        finished = feasible & (violation[k] >= 0)
        chosen = jnp.arange(n) == k
        part_of_the_way = jnp.where(chosen, 0, x + fraction[k] * (target - x))
        x = jnp.where(feasible, target, part_of_the_way)
        S = jnp.where(chosen & ~finished, feasible, S)  # taken in, or let go
        # To pivot a member out again would bring back the rounding of all that was pivoted in: begin anew without it.
        again = lambda: pivoted_on(untouched, S)
        T = lax.cond(feasible, lambda: jnp.where(finished, T, principal_pivot(T, k)), again)
        return _Search(T, S, x, finished, count + 1)

    untouched = jnp.column_stack([matrix, vector])
    alone = jnp.sum(candidates) <= 1  # the usual case: nothing to search
    S = candidates & alone & (vector < -noise)
    start = _Search(untouched, S, jnp.zeros_like(vector), alone, jnp.array(0))
    # Room for turns that is not used up: of 48,000 random problems, regular and singular, none took more than 2.4 n.
    return lax.while_loop(lambda carry: ~carry.finished & (carry.count < 4 * n + 4), turn, start).S


def _support_of_two(matrix, vector, candidates, noise):
    """The same for two unknowns, the most common case: all that the search could do, written out."""
    violation = jnp.where(candidates, vector + noise, jnp.inf)
    first = jnp.argmin(violation)
    k = jnp.arange(2) == first  # the one that is violated most, and j, the other
    of = lambda one, values: jnp.sum(jnp.where(one, values, 0))
    W_kk, W_jj, W_kj = of(k, jnp.diag(matrix)), of(~k, jnp.diag(matrix)), matrix[0, 1]
    taken = of(k, violation) < 0
    W_kk = jnp.where(taken, W_kk, 1)
    left = W_jj - W_kj**2 / W_kk
    x_k, residual = -of(k, vector) / W_kk, of(~k, vector) - W_kj * of(k, vector) / W_kk
    joined = taken & (left > closeness(matrix.dtype) * W_jj) & (of(~k, jnp.where(candidates, residual + noise, 0)) < 0)
    # Where j, once in, would make x_k negative, k is let go: j alone is the solution then.
    stays = ~joined | (x_k + W_kj / W_kk * residual / jnp.where(joined, left, 1) > 0)
    return (k & taken & stays) | (~k & joined)


def independent_superset(
    matrix: Float[Array, "n n"], S: Bool[Array, "n"], candidates: Bool[Array, "n"]
) -> Bool[Array, "n"]:
    """S and as many more candidates as leave W regular on the set: three of the four feet of a table."""
    matrix = lax.stop_gradient(matrix)
    least = closeness(matrix.dtype) * jnp.diag(matrix)
    if S.shape[0] == 2:  # one that is not in S is eligible if the other one, where it is inside, leaves something of it
        W_ii, W_jj = jnp.diag(matrix), jnp.diag(matrix)[::-1]
        left = W_ii - matrix[0, 1] ** 2 / jnp.where(W_jj > 0, W_jj, 1)
        beside, by_itself = candidates & (left > least), candidates & (W_ii > least)
        first = S[0] | jnp.where(S[1], beside[0], by_itself[0])
        return jnp.stack([first, S[1] | jnp.where(first, beside[1], by_itself[1])])

    def next_one(T, inside):
        """S comes first; then those that are left and do not depend on those inside."""
        eligible = (S | candidates) & ~inside & (S | (jnp.diagonal(T) > least))
        return jnp.argmax(jnp.where(eligible, 1 + S, 0)), jnp.any(eligible)

    def take(carry):
        T, inside, k, _ = carry
        T, inside = principal_pivot(T, k), inside | (jnp.arange(inside.shape[0]) == k)
        return T, inside, *next_one(T, inside)

    more = jnp.any(candidates & ~S)
    inside = S & ~more  # all there is where nobody is to be added: nothing to search
    k, eligible = next_one(matrix, inside)
    return lax.while_loop(lambda carry: carry[3], take, (matrix, inside, k, eligible & more))[1]
