"""Mass matrices and their structure: an array, or a `lineax` operator that says what it is.

Of an array the trace tells whether it is diagonal everywhere, or the same everywhere and solved for once before the
motion begins."""

from typing import Any, Literal

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jax import lax
from jax.extend.core import jaxprs_in_params
from jaxtyping import Array, Bool, Float

from ..interval.arithmetic import Interval
from ..interval.calls import called
from ..interval.enclosure import ranges
from ..interval.kind import Kind, kinds
from ..interval.repeats import needed_for
from ..numerics.dense import UNROLLED, linear_solve, pivots, refined, solve_spd
from ..numerics.fixed import Fixed
from .scene import AbstractScene
from .wrapped import WrappedScene


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
    """A scene whose mass matrix is diagonal, or does not depend on q."""

    form: Literal["identity", "diagonal", "dense"] = eqx.field(static=True)
    inverse: Fixed | None
    """Of a dense one; its bits, so that it is no parameter: derivatives go by the matrix itself."""

    def mass_matrix(self, q):
        if self.form == "identity":
            return lx.IdentityLinearOperator(jax.ShapeDtypeStruct(q.shape, q.dtype))
        matrix = _as_array(self.scene, q)
        if self.form == "diagonal":
            # Every (n + 1)-th entry: the derivative of `jnp.diagonal` is a scatter.
            return lx.DiagonalLinearOperator(matrix.reshape(-1)[:: q.shape[0] + 1])
        assert self.inverse is not None
        return ConstantMass(matrix, self.inverse.number)

    def _load(self, t, q, v):
        return self.scene._load(t, q, v)


def with_known_mass(scene: AbstractScene, q) -> AbstractScene:
    """The scene, with what the trace tells of a mass matrix that is an array.

    The identity and a diagonal one are solved as such; of another that does not depend on q the inverse is found once.
    A small one is left as it is: to eliminate it costs no more than to apply an inverse."""
    if not _is_dense(scene, q):
        return scene
    leaves, rest = eqx.partition(scene, eqx.is_array)
    trace = jax.make_jaxpr(lambda leaves, q: _as_array(eqx.combine(leaves, rest), q))(leaves, q)
    form = _form(trace)
    if form != "dense":
        return KnownMass(scene, form, None)
    fixed = [np.zeros(leaf.shape, int) for leaf in jax.tree.leaves(leaves)]
    if q.shape[0] <= UNROLLED or (kinds(trace, [*fixed, np.full(q.shape, Kind.AFFINE)]) != Kind.CONSTANT).any():
        return scene
    matrix = lax.stop_gradient(_as_array(scene, q))
    return KnownMass(scene, "dense", Fixed.of(solve_spd(matrix, jnp.eye(q.shape[0], dtype=q.dtype)), q.dtype))


def _form(trace) -> Literal["identity", "diagonal", "dense"]:
    """The form of a matrix for whatever parameters and q, from the range of each of its entries."""
    traced = any(isinstance(constant, jax.core.Tracer) for constant in trace.consts)
    if traced or not _all_real(trace.in_avals) or _has_rules_of_a_user(trace.jaxpr):
        return "dense"
    with jax.ensure_compile_time_eval():
        (entries,) = ranges(trace, [_anything(aval) for aval in trace.in_avals])
        low, high = np.asarray(entries.low), np.asarray(entries.high)
    known = np.where(low == high, low, np.nan)
    if np.array_equal(known, np.eye(len(known))):
        return "identity"
    return "diagonal" if not known[~np.eye(len(known), dtype=bool)].any() else "dense"  # nan counts as true


def _all_real(avals) -> bool:
    return all(jnp.issubdtype(aval.dtype, jnp.floating) for aval in avals)


def _has_rules_of_a_user(jaxpr) -> bool:
    """Whether a derivative rule was written by hand: what is 0 everywhere may have a derivative then."""
    own = lambda equation: equation.primitive.name in ("custom_jvp_call", "custom_vjp_call") and not called(equation)
    inside = lambda equation: map(_has_rules_of_a_user, jaxprs_in_params(equation.params))
    needed, _ = needed_for(list(jaxpr.eqns), list(jaxpr.outvars))
    return any(own(equation) or any(inside(equation)) for equation in needed)


def _anything(aval) -> Interval:
    """All numbers but the very largest (3e34 in single precision): zero times what overflows is not known to be 0."""
    most = jnp.full(aval.shape, float(jnp.finfo(aval.dtype).max) ** 0.9, aval.dtype)
    return Interval(-most, most)


def _is_dense(scene: AbstractScene, q) -> bool:
    return not isinstance(structured(scene.mass_matrix(q)), lx.AbstractLinearOperator | ConstantMass)


def _as_array(scene: AbstractScene, q):
    return jnp.asarray(structured(scene.mass_matrix(q)))
