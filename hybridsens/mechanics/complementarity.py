"""The linear complementarity problem that stands for Gauss's principle (T2) and for the impact law (T3)."""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..numerics.tolerances import closeness
from .delassus import Delassus


class _Problem(NamedTuple):
    """What is searched."""

    W: Delassus
    untouched: Float[Array, "n columns"]
    """The tableau of (W, b) before any pivot."""
    size: Float[Array, "n"]
    """W_ii^(1/2), which makes unknowns of different units alike."""
    candidates: Bool[Array, "n"]
    noise: Float[Array, "n"]


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
    W: Delassus,
    vector: Float[Array, "n"],
    candidates: Bool[Array, "n"],
    noise: Float[Array, "n"],
) -> Bool[Array, "n"]:
    """The index set S of the positive unknowns in

        0 <= x _|_ W x + b >= 0   on the candidates, x = 0 elsewhere,   W = W^T >= 0.

    Active sets in the manner of Lawson and Hanson (1974, ch. 23), for the problem's quadratic programme: take in the
    candidate that is violated most, solve with equality on S, and drop the first unknown that comes to zero on the way.
    One tableau is kept: it holds x_S, the residual, and on its diagonal the Schur complement of W_SS. To take a contact
    in is a principal pivot, O(n^2) at most; to drop one builds the tableau anew. W_SS stays regular even where W is
    singular: a contact whose column depends on those of S enters only in the place of a member, once no other one is
    violated (of two parallel walls the one that asks for more). Where no member gives way the problem has no solution,
    as for two walls that close on a body, and S is left as it is.
    `noise` is how large a residual rounding alone can make. Nothing here is differentiated: S is piecewise constant,
    and x_S = -W_SS^-1 b_S is solved again where its derivative is wanted.
    """
    W, vector, noise = lax.stop_gradient((W, vector, noise))
    n = vector.shape[0]
    if n == 0:
        return candidates
    if n == 1:
        return candidates & (vector < -noise)
    if n == 2:
        return _support_of_two(W.rows, vector, candidates, noise)

    return _searched(_Problem(W, W.tableau(vector), jnp.sqrt(W.diagonal()), candidates, noise)).S


def _searched(problem: _Problem) -> _Search:
    """The end of the search that starts from the empty set."""
    vector, n = problem.untouched[:, -1], problem.noise.shape[0]
    alone = jnp.sum(problem.candidates) <= 1  # the usual case: nothing to search
    S = problem.candidates & alone & (vector < -problem.noise)
    start = _Search(problem.untouched, S, jnp.zeros_like(vector), alone, jnp.array(0))
    # Room for turns that is not used up: of 54,000 random problems, regular and singular, none took more than 2 n.
    goes_on = lambda search: ~search.finished & (search.count < 4 * n + 4)
    return lax.while_loop(goes_on, lambda search: _turn(problem, search), start)


def _turn(problem: _Problem, search: _Search) -> _Search:
    """A candidate enters, or replaces a member; or a member is let go; or all is found."""
    W, untouched, size, candidates, noise = problem
    T, S, x, _, count = search
    at = lambda k: jnp.arange(S.shape[0]) == k
    value = T[:, -1]  # of members: x; of the others: the residual
    negative = S & (value <= 0)
    feasible = ~jnp.any(negative)
    independent = W.independent(T, S)
    violation = jnp.where(candidates & ~S, value + noise, jnp.inf)
    violated = jnp.where(independent, violation, jnp.inf)
    k, j = jnp.argmin(violated), jnp.argmin(jnp.where(independent, jnp.inf, violation))
    enters = feasible & (violated[k] < 0)
    # One that depends on S enters only in the place of a member: by its own push that of the member is less.
    push = W.column(T, j)
    gives_way = S & (push * size < -closeness(push.dtype) * size[j])
    replaces = feasible & ~enters & ~independent[j] & (violation[j] < 0) & jnp.any(gives_way)
    stays = feasible & ~replaces
    # On the way, from what is feasible, the first member that comes to zero is let go.
    way = (value, push, gives_way), (x, value - x, negative)
    left, first, fraction = _first_at_zero(*(jnp.where(feasible, *ends) for ends in zip(*way, strict=True)))
    others, in_its_place = S & ~at(first), at(j) & replaces
    x = jnp.where(stays, jnp.where(S, value, 0), jnp.where(others, left, jnp.where(in_its_place, fraction, 0)))
    S = jnp.where(stays, S | (at(k) & enters), others | in_its_place)
    # To pivot a member out again would bring back the rounding of all that was pivoted in: begin anew without it.
    again = lambda: W.pivoted_on(untouched, S)
    T = lax.cond(stays, lambda: jnp.where(enters, W.pivot(T, k), T), again)
    return _Search(T, S, x, stays & ~enters, count + 1)


def _first_at_zero(reached, way, falls):
    """Where the way from a point is left at which one that falls comes to zero, which one, and how far that is."""
    fraction = jnp.where(falls, reached / jnp.where(falls, -way, 1), jnp.inf)
    first = jnp.argmin(fraction)
    return reached + fraction[first] * way, first, fraction[first]


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
    violated = taken & (of(~k, jnp.where(candidates, residual + noise, 0)) < 0)
    independent, tiny = left > closeness(matrix.dtype) * W_jj, closeness(matrix.dtype) * jnp.sqrt(W_kk * W_jj)
    joined = violated & independent
    # Where j, once in, would make x_k negative, k is let go: j alone is the solution then.
    stays = ~joined | (x_k + W_kj / W_kk * residual / jnp.where(joined, left, 1) > 0)
    replaced = violated & ~independent & (W_kj > tiny)  # two parallel walls, of which j asks for more
    return (k & taken & stays & ~replaced) | (~k & (joined | replaced))


def independent_superset(W: Delassus, S: Bool[Array, "n"], candidates: Bool[Array, "n"]) -> Bool[Array, "n"]:
    """S and as many more candidates as leave W regular on the set: three of the four feet of a table."""
    W = lax.stop_gradient(W)
    if S.shape[0] == 2:  # one that is not in S is eligible if the other one, where it is inside, leaves something of it
        W_ii, W_jj = W.diagonal(), W.diagonal()[::-1]
        least = closeness(W_ii.dtype) * W_ii
        left = W_ii - W.rows[0, 1] ** 2 / jnp.where(W_jj > 0, W_jj, 1)
        beside, by_itself = candidates & (left > least), candidates & (W_ii > least)
        first = S[0] | jnp.where(S[1], beside[0], by_itself[0])
        return jnp.stack([first, S[1] | jnp.where(first, beside[1], by_itself[1])])

    def next_one(T, inside):
        """S comes first; then those that are left and do not depend on those inside."""
        eligible = (S | candidates) & ~inside & (S | W.independent(T, inside))
        return jnp.argmax(jnp.where(eligible, 1 + S, 0)), jnp.any(eligible)

    def take(carry):
        T, inside, k, _ = carry
        T, inside = W.pivot(T, k), inside | (jnp.arange(inside.shape[0]) == k)
        return T, inside, *next_one(T, inside)

    more = jnp.any(candidates & ~S)
    inside = S & ~more  # S itself where no candidate is left to add
    k, eligible = next_one(W.rows, inside)
    return lax.while_loop(lambda carry: carry[3], take, (W.rows, inside, k, eligible & more))[1]
