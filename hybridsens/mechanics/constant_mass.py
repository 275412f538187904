"""A mass matrix that is the same everywhere, told from its trace, and solved for once before the motion begins."""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
from jax import lax

from ..interval.kind import Kind, kinds
from ..numerics.dense import UNROLLED, solve_spd
from .mass import ConstantMass, structured
from .scene import AbstractScene
from .typed import Fixed, WrappedScene


class KnownMass(WrappedScene):
    """A scene whose mass matrix does not depend on q."""

    scene: AbstractScene
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

    def force(self, t, q, v):
        return self.scene.force(t, q, v)

    def gap(self, t, q):
        return self.scene.gap(t, q)

    def restitution(self):
        return self.scene.restitution()


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
