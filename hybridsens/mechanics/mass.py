"""Mass matrices and their structure: an array, or a `lineax` operator that says what it is.

One that is the same everywhere is told from its trace, and solved for once before the motion begins."""

from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ..interval.kind import Kind, kinds
from ..numerics.dense import UNROLLED, linear_solve, pivots, refined, solve_spd
from .scene import AbstractScene
from .wrapped import Fixed, WrappedScene


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
        return is_symmetric(mass.lower_diagonal, mass.upper_diagonal) & jnp.all(_tridiagonal_pivots(mass) > 0)
    matrix = mass.matrix if isinstance(mass, ConstantMass) else mass
    assert not isinstance(matrix, lx.AbstractLinearOperator)
    return is_symmetric(matrix, matrix.T) & jnp.all(pivots(matrix) > 0)


def is_symmetric(lower, upper) -> Bool[Array, ""]:
    """Whether two triangles, or a matrix and its transpose, are the same up to rounding."""
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


class KnownMass(WrappedScene):
    """A scene whose mass matrix does not depend on q."""

    form: Literal["identity", "diagonal", "dense"] = eqx.field(static=True)
    inverse: Fixed | None
    """Of a dense one; its bits, so that it is no parameter: derivatives go by the matrix itself."""

    def mass_matrix(self, q):
        if self.form == "identity":
            return lx.IdentityLinearOperator(jax.ShapeDtypeStruct(q.shape, q.dtype))
        matrix = _as_array(self.scene, q)
        if self.form == "diagonal":
            return lx.DiagonalLinearOperator(jnp.diagonal(matrix))
        assert self.inverse is not None
        return ConstantMass(matrix, self.inverse.number)

    def _load(self, t, q, v):
        return self.scene._load(t, q, v)


def with_known_mass(scene: AbstractScene, q) -> AbstractScene:
    """The scene, with the inverse of its mass matrix found once where the matrix is dense and does not depend on q.

    One that is a number in the program, as `jnp.eye(dof)` is, shows its zeros too. Small ones are left as they are:
    to eliminate them costs no more than to apply an inverse."""
    if q.shape[0] <= UNROLLED or not _is_dense(scene, q):
        return scene
    leaves, rest = eqx.partition(scene, eqx.is_array)
    matrix_of = lambda leaves, q: _as_array(eqx.combine(leaves, rest), q)
    trace, fixed = jax.make_jaxpr(matrix_of)(leaves, q), jax.tree.map(lambda leaf: np.zeros(leaf.shape, int), leaves)
    if (kinds(trace, [*jax.tree.leaves(fixed), np.full(q.shape, Kind.AFFINE)]) != Kind.CONSTANT).any():
        return scene
    moving = [np.full(leaf.shape, Kind.AFFINE) for leaf in jax.tree.leaves(leaves)]
    if not trace.consts and (kinds(trace, [*moving, np.zeros(q.shape, int)]) == Kind.CONSTANT).all():
        form = _form(matrix_of, leaves, q)
        if form != "dense":
            return KnownMass(scene, form, None)
    matrix = lax.stop_gradient(_as_array(scene, q))
    return KnownMass(scene, "dense", Fixed.of(solve_spd(matrix, jnp.eye(q.shape[0], dtype=q.dtype)), q.dtype))


def _form(matrix_of, leaves, q) -> Literal["identity", "diagonal", "dense"]:
    """The form of a matrix that depends on nothing, so that any leaves do."""
    with jax.ensure_compile_time_eval():
        blank = jax.tree.map(lambda leaf: jnp.ones(leaf.shape, leaf.dtype), leaves)
        matrix = np.asarray(matrix_of(blank, jnp.ones(q.shape, q.dtype)))
    if np.array_equal(matrix, np.eye(q.shape[0])):
        return "identity"
    return "diagonal" if np.array_equal(matrix, np.diag(np.diagonal(matrix))) else "dense"


def _is_dense(scene: AbstractScene, q) -> bool:
    return not isinstance(structured(scene.mass_matrix(q)), lx.AbstractLinearOperator | ConstantMass)


def _as_array(scene: AbstractScene, q):
    return jnp.asarray(structured(scene.mass_matrix(q)))
