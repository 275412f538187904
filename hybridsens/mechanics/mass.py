"""Mass matrices and their structure: an array, or a `lineax` operator that says what it is."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics.dense import linear_solve, pivots, refined, solve_spd


class ConstantMass(eqx.Module):
    """A dense mass matrix whose inverse is known before the motion begins."""

    matrix: Float[Array, "dof dof"]
    inverse: Float[Array, "dof dof"]
    """Not differentiated: derivatives go by the matrix."""


Mass = Array | lx.AbstractLinearOperator | ConstantMass


def structured(mass: Mass) -> Mass:
    """A mass matrix in the form that it is solved in: identity, diagonal, tridiagonal, known inverse, or an array."""
    if not isinstance(mass, lx.AbstractLinearOperator) or isinstance(mass, lx.IdentityLinearOperator):
        return mass
    if lx.is_diagonal(mass):
        return lx.DiagonalLinearOperator(lx.diagonal(mass))
    if lx.is_tridiagonal(mass):
        return lx.TridiagonalLinearOperator(*lx.tridiagonal(mass))
    return mass.as_matrix()


def solve_mass(mass: Mass, right: Float[Array, "dof *m"]) -> Float[Array, "dof *m"]:
    """M^-1 b; b is a vector or has one column per right-hand side. What the type says of M is made use of."""
    mass = structured(mass)
    if isinstance(mass, lx.IdentityLinearOperator):
        return right
    if isinstance(mass, lx.DiagonalLinearOperator):
        return (right.T / mass.diagonal).T
    if isinstance(mass, lx.TridiagonalLinearOperator):
        return _solve_tridiagonal(mass, right)
    if isinstance(mass, ConstantMass):
        known = refined(lax.stop_gradient(mass.matrix), mass.inverse)
        return linear_solve(lambda x: mass.matrix @ x, right, known)
    assert not isinstance(mass, lx.AbstractLinearOperator)  # `structured` leaves no other one
    return solve_spd(mass, right)


def mass_entries(mass: Mass) -> Any:
    """All numbers that the mass matrix is made of: an array, or the bands of a diagonal or tridiagonal one."""
    mass = structured(mass)
    if isinstance(mass, lx.IdentityLinearOperator):
        return ()
    if isinstance(mass, lx.DiagonalLinearOperator):
        return mass.diagonal
    if isinstance(mass, lx.TridiagonalLinearOperator):
        return mass.lower_diagonal, mass.diagonal, mass.upper_diagonal
    return mass.matrix if isinstance(mass, ConstantMass) else mass


def is_positive_definite(mass: Mass) -> Bool[Array, ""] | bool:
    """Whether a mass matrix is symmetric and positive definite, up to rounding."""
    mass = structured(mass)
    if isinstance(mass, lx.IdentityLinearOperator):
        return True
    if isinstance(mass, lx.DiagonalLinearOperator):
        return jnp.all(mass.diagonal > 0)
    if isinstance(mass, lx.TridiagonalLinearOperator):
        return _is_symmetric(mass.lower_diagonal, mass.upper_diagonal) & jnp.all(_tridiagonal_pivots(mass) > 0)
    matrix = mass.matrix if isinstance(mass, ConstantMass) else mass
    assert not isinstance(matrix, lx.AbstractLinearOperator)
    return _is_symmetric(matrix, matrix.T) & jnp.all(pivots(matrix) > 0)


def _is_symmetric(lower, upper) -> Bool[Array, ""]:
    size = jnp.max(jnp.abs(lower), initial=0)
    return jnp.max(jnp.abs(lower - upper), initial=0) <= 1e3 * jnp.finfo(lower.dtype).eps * size


def _solve_tridiagonal(mass: lx.TridiagonalLinearOperator, right):
    """By the library's elimination of a band; the derivative is a solve again."""
    held = lax.stop_gradient(mass)
    end = jnp.zeros(1, right.dtype)
    bands = jnp.concatenate([end, held.lower_diagonal]), held.diagonal, jnp.concatenate([held.upper_diagonal, end])

    def solve(b):
        columns = b.reshape(b.shape[0], -1)
        return lax.linalg.tridiagonal_solve(*bands, columns).reshape(b.shape)

    times = jnp.vectorize(mass.mv, signature="(n)->(n)")
    return linear_solve(lambda x: times(x.T).T, right, solve)


def _tridiagonal_pivots(mass: lx.TridiagonalLinearOperator) -> Float[Array, "dof"]:
    """d_i = a_i - l_i^2 / d_{i-1}."""

    def pivot(before, row):
        d = row[0] - row[1] ** 2 / before
        return d, d

    lower = jnp.concatenate([jnp.zeros(1, mass.diagonal.dtype), mass.lower_diagonal])
    return jax.lax.scan(pivot, jnp.ones((), mass.diagonal.dtype), (mass.diagonal, lower))[1]
