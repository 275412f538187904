"""Small symmetric positive definite systems, eliminated by plain arithmetic.

A call into LAPACK inside a compiled loop costs more than the elimination itself and keeps XLA from compiling
the loop into one kernel, so systems of up to `UNROLLED` unknowns are written out; larger ones go to the library.
"""

import jax.numpy as jnp
import jax.scipy.linalg as jsl
from jaxtyping import Array, Float

UNROLLED = 8


def solve_spd(matrix: Float[Array, "n n"], right: Float[Array, "n *m"]) -> Float[Array, "n *m"]:
    """Solve A x = b for a symmetric positive definite A; b is a vector or has one column per right-hand side."""
    if matrix.shape[0] <= UNROLLED:
        return _solve_ldl(*_ldl(matrix), right)
    return jsl.cho_solve(jsl.cho_factor(matrix), right)


def pivots(matrix: Float[Array, "n n"]) -> Float[Array, "n"]:
    """Pivots of the elimination of a symmetric matrix: all positive if and only if it is positive definite."""
    if matrix.shape[0] <= UNROLLED:
        return jnp.stack(_ldl(matrix)[1]) if matrix.shape[0] else jnp.zeros(0, matrix.dtype)
    return jnp.linalg.eigvalsh(matrix)


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
    if n == 0:
        return b
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
    """Solve A_SS x_S = b_S, x = 0 outside S, where `members` is 1 in S and 0 outside (A_SS must be definite)."""
    return solve_spd(matrix * jnp.outer(members, members) + jnp.diag(1 - members), right * members)
