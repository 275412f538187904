"""Symmetric positive definite systems of any size, with one derivative rule: A dx = db - dA x.

A call into LAPACK inside a compiled loop costs more than a small elimination itself and keeps XLA from compiling the
loop into one kernel, so small systems are written out, and those of middle size are inverted by a loop of pivots.
"""

import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from .batch_axes import batch_in_front

UNROLLED = 4
"""Up to this many unknowns the elimination is written out: it takes n^3 / 6 operations to compile."""
SMALL = 8
"""Up to this many all of a matrix is inverted where some of it would do: to look for these takes two loops more, and
compiling them takes longer than all pivots of many motions."""
LOOPED = 32
"""Up to this many the inverse is made by a loop of pivots; beyond, the library is faster."""


def solve_spd(matrix: Float[Array, "n n"], right: Float[Array, "n *m"]) -> Float[Array, "n *m"]:
    """Solve A x = b for a symmetric positive definite A; b is a vector or has one column per right-hand side."""
    if matrix.shape[0] == 0:
        return right
    if matrix.shape[0] == 1:
        return right / matrix[0, 0]
    if matrix.shape[0] == 2:
        return _solve_for_two(matrix, right)
    return _solve(matrix, right)


@jax.custom_jvp
def _solve_for_two(matrix, right):
    """By the inverse: an elimination has a quotient for every entry, and XLA makes a kernel of each. (Of three and four
    unknowns the inverse, written out, compiles half as long again as the elimination.)"""
    return batch_in_front(_inverse_of_two(matrix) @ right)


@_solve_for_two.defjvp
def _solve_for_two_jvp(primals, tangents):
    """dx = A^-1 (db - dA x), by the inverse that is at hand."""
    (matrix, right), (d_matrix, d_right) = primals, tangents
    inverse = _inverse_of_two(matrix)
    x = inverse @ right
    return batch_in_front((x, inverse @ (d_right - d_matrix @ x)))


def _inverse_of_two(A):
    """The adjugate over the pivots, one after the other, since their product may be too small for a number."""
    first = 1 / A[0, 0]
    second = 1 / (A[1, 1] - A[0, 1] * first * A[0, 1])
    adjugate = lax.rev(A, (0, 1)) * np.array([[1, -1], [-1, 1]])
    return adjugate * first * second


@jax.custom_jvp
def _solve(matrix, right):
    return batch_in_front(_solver(matrix)(right))


@_solve.defjvp
def _solve_jvp(primals, tangents):
    """Nothing is differentiated through an elimination, in no mode and no order: all derivatives are solves again."""
    return jax.jvp(_solve_by_rule, primals, tangents)


def _solve_by_rule(matrix, right):
    return batch_in_front(linear_solve(lambda x: matrix @ x, right, _solver(lax.stop_gradient(matrix))))


def linear_solve(product, right, solve) -> Array:
    """`solve(right)`, differentiated as the solution of a symmetric system, product(x) = right."""
    return lax.custom_linear_solve(product, right, lambda _, b: solve(b), symmetric=True)


def _solver(matrix):
    """A function of b that solves A x = b, made from A once."""
    if matrix.shape[0] <= UNROLLED:
        factors = _ldl(matrix)
        return lambda b: _solve_ldl(*factors, b)
    if matrix.shape[0] <= LOOPED:
        return refined(matrix, _inverse(matrix))
    factor = jsl.cho_factor(matrix)
    return lambda b: jsl.cho_solve(factor, b)


def refined(matrix: Float[Array, "n n"], inverse: Float[Array, "n n"]):
    """A^-1 b by a known inverse and one correction by what is left, which makes it as exact as factors are."""

    def solve(b):
        x = inverse @ b
        return x + inverse @ (b - matrix @ x)

    return solve


def pivots(matrix: Float[Array, "n n"]) -> Float[Array, "n"]:
    """Pivots of the elimination of a symmetric matrix: all positive if and only if it is positive definite.

    Where they are not, those after the first one that is not positive mean nothing."""
    n = matrix.shape[0]
    if n <= UNROLLED:
        return jnp.stack(_ldl(matrix)[1]) if n else jnp.zeros(0, matrix.dtype)
    if n <= LOOPED:
        take = lambda k, carry: (principal_pivot(carry[0], k), carry[1].at[k].set(carry[0][k, k]))
        return lax.fori_loop(0, n, take, (matrix, jnp.zeros(n, matrix.dtype)))[1]
    return jnp.diagonal(jnp.linalg.cholesky(matrix))  # not a number where there is none


def principal_pivot(tableau: Float[Array, "n columns"], k) -> Float[Array, "n columns"]:
    """The relations y = T (x, 1) with x_k and y_k exchanged (Tucker's principal pivot): O(n^2).

    From T = (W, b), pivoted on every member of S: the rows of S tell x_S = -W_SS^-1 b_S, the others the residual
    W x + b, and the diagonal of the others what is left of W when S is eliminated: 0 for a column that depends on S."""
    n, columns = tableau.shape
    here, there = jnp.arange(n) == k, jnp.arange(columns) == k
    row, column = jnp.where(there, -1, tableau[k]) / -tableau[k, k], tableau[:, k]
    rest = jnp.where(there, 0, tableau) + column[:, None] * row
    return jnp.where(here[:, None], row, rest)


def pivoted_on(
    tableau: Float[Array, "n columns"], members: Bool[Array, "n"], pivot=principal_pivot
) -> Float[Array, "n columns"]:
    """The tableau after a principal pivot on each member."""

    n = members.shape[0]

    def next_member(k):
        """The first one from place k on; n where there is none. By a loop, which compiles to less than a minimum."""
        is_none = lambda k: (k < n) & ~lax.dynamic_index_in_dim(members, k, keepdims=False)
        return lax.while_loop(is_none, lambda k: k + 1, k)

    take = lambda carry: (pivot(*carry), next_member(carry[1] + 1))
    return lax.while_loop(lambda carry: carry[1] < n, take, (tableau, next_member(jnp.array(0))))[0]


def _inverse(matrix):
    """By n pivots of the whole array in one loop: little to compile."""
    return lax.fori_loop(0, matrix.shape[0], lambda k, T: principal_pivot(T, k), matrix)


def _ldl(A):
    """A = L D L^T with unit lower triangular L, as nested lists of scalars."""
    n = A.shape[0]
    L = [[None] * n for _ in range(n)]
    d = []
    for j in range(n):
        d.append(A[j, j] - sum(L[j][k] ** 2 * d[k] for k in range(j)))
        for i in range(j + 1, n):
            L[i][j] = (A[i, j] - sum(L[i][k] * L[j][k] * d[k] for k in range(j))) / d[j]
    return L, d


def _solve_ldl(L, d, b):
    n = len(d)
    y = []
    for i in range(n):
        y.append(b[i] - sum(L[i][k] * y[k] for k in range(i)))
    x: list = [None] * n
    for i in reversed(range(n)):
        x[i] = y[i] / d[i] - sum(L[k][i] * x[k] for k in range(i + 1, n))
    return jnp.stack(x)


def solve_masked(
    matrix: Float[Array, "n n"], right: Float[Array, "n"], members: Float[Array, "n"]
) -> Float[Array, "n"]:
    """Solve A_SS x_S = b_S, x = 0 outside S, where `members` is 1 in S and 0 outside (A_SS must be definite).

    Beyond `SMALL` by one pivot for every member: what has few members costs little. (Outside of S it is the identity,
    which pivots leave as it is.)"""
    masked = matrix * jnp.outer(members, members) + jnp.diag(1 - members)
    if matrix.shape[0] <= UNROLLED:
        return solve_spd(masked, right * members)
    held = lax.stop_gradient(masked)
    is_small = matrix.shape[0] <= SMALL
    inverse = _inverse(held) if is_small else pivoted_on(held, lax.stop_gradient(members) > 0)
    return linear_solve(lambda x: masked @ x, right * members, refined(held, inverse))
