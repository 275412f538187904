"""Contacts at one instant: Phi, its rate, its gradient, its acceleration; and the few that matter, out of many, among
which alone laws are worked out."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..interval.kind import Kind, kinds
from .delassus import Delassus
from .mass import solve_mass
from .scene import AbstractScene
from .wrapped import WrappedScene

FEW = 8
"""Scenes of up to this many contacts look at all of them."""

MANY = 4
"""With so many times more contacts than coordinates W is kept as its factors."""


class Instant(NamedTuple):
    """A time, and the configuration and velocity there."""

    t: Float[Array, ""]
    q: Float[Array, "dof"]
    v: Float[Array, "dof"]


def gap_and_rate(scene: AbstractScene, t, q, v) -> tuple[Float[Array, "contact"], Float[Array, "contact"]]:
    """Gaps Phi(t, q) [m] and their rates Phi' = Phi_t + G^T v [m/s]."""
    return jax.jvp(scene.gap, (t, q), (jnp.ones_like(t), v))


def walls_move(scene: AbstractScene, t, q) -> bool:
    """Whether a gap depends on time, as the trace tells."""
    by_time = [np.array(Kind.AFFINE), np.full(q.shape, Kind.CONSTANT)]
    return bool(kinds(jax.make_jaxpr(scene.gap)(t, q), by_time).any())


def gap_rate_and_bias(scene: AbstractScene, t, q, v) -> tuple[Float[Array, "contact"], Float[Array, "contact"]]:
    """Gap rates [m/s] and gamma = Phi_tt + 2 Phi_tq v + v^T Phi_qq v [m/s^2], so that Phi'' = G^T v' + gamma."""
    return jax.jvp(lambda t, q: gap_and_rate(scene, t, q, v)[1], (t, q), (jnp.ones_like(t), v))


def contact_jacobian(scene: AbstractScene, t, q) -> Float[Array, "contact dof"]:
    """dPhi/dq, the paper's G transposed: by rows where few contacts were picked and there are far more coordinates."""
    contacts = jax.eval_shape(scene.gap, t, q).shape[0]
    derivative = jax.jacrev if 4 * contacts <= q.shape[0] and isinstance(scene, SomeContacts) else jax.jacfwd
    return derivative(scene.gap, argnums=1)(t, q)


class ContactGeometry(eqx.Module):
    """Everything about the contacts that the laws of motion and of impact need, at one (t, q, v)."""

    jacobian: Float[Array, "contact dof"]
    """dPhi/dq = G^T."""
    mobility: Float[Array, "dof contact"]
    """M^-1 G: what a unit impulse at each contact does to the velocities."""
    delassus: Delassus
    """W = G^T M^-1 G."""


def contact_geometry(scene: AbstractScene, t, q) -> ContactGeometry:
    """G^T, M^-1 G and W = G^T M^-1 G at (t, q)."""
    jacobian = contact_jacobian(scene, t, q)
    mobility = solve_mass(scene.mass_matrix(q), jacobian.T)
    contacts, dof = jacobian.shape
    by_factors = contacts > FEW and contacts >= MANY * dof
    delassus = Delassus(jacobian, dof, mobility) if by_factors else Delassus(jacobian @ mobility, dof)
    return ContactGeometry(jacobian, mobility, delassus)


class SomeContacts(WrappedScene):
    """A scene with some of its contacts; the others are not there."""

    which: Int[Array, "few"]

    def gap(self, t, q):
        return _picked(self.scene.gap(t, q), self.which)

    def restitution(self):
        return _picked(self.scene.restitution(), self.which)


class Among(NamedTuple):
    """What is worked out among contacts, and what is said of those that are left out."""

    run: Callable[[AbstractScene, Any], tuple[Any, Any]]
    """(scene, by_contact) -> what it says of each contact, and the rest."""
    by_contact: Any
    elsewhere: Any


def among_wanted(
    scene: AbstractScene, wanted: Bool[Array, "contact"], among: Among, at_most: int | None = None
) -> tuple[Any, Any]:
    """`among.run` with the contacts that are wanted: with one where no other is wanted, else with all, or with as many
    as can be wanted `at_most`.

    A law for one contact is short. For two it would take as long to compile as for all."""
    if wanted.shape[0] <= FEW:
        return among.run(scene, among.by_contact)
    # On the way back each branch is worked out again. Otherwise the matrices of all contacts would be handed on, as
    # zeros, where one of them was looked at.
    alone = jax.checkpoint(lambda: _among_first(scene, wanted, 1, among))
    among_all = lambda: among.run(scene, among.by_contact)
    few = wanted.shape[0] if at_most is None else at_most
    together = jax.checkpoint(lambda: _among_first(scene, wanted, few, among) if few < len(wanted) else among_all())
    return lax.cond(jnp.sum(wanted) <= 1, alone, together)


def among_held(scene: AbstractScene, held: Bool[Array, "contact"], dof: int, among: Among) -> tuple[Any, Any]:
    """The same with the contacts that are held. These are independent, so that there are at most as many of them as
    coordinates: a body of few coordinates needs no more, however many contacts it has."""
    if held.shape[0] > FEW and dof <= FEW:
        return _among_first(scene, held, dof, among)
    return among_wanted(scene, held, among)


def _among_first(scene: AbstractScene, wanted, count: int, among: Among) -> tuple[Any, Any]:
    """`among.run` with `count` contacts, those that are wanted before the others."""
    which = _first(wanted, count)
    found, rest = among.run(SomeContacts(scene, which), jax.tree.map(lambda leaf: leaf[which], among.by_contact))
    return jax.tree.map(lambda of_few, of_all: _spread(of_few, which, of_all), found, among.elsewhere), rest


def _first(wanted: Bool[Array, "contact"], count: int) -> Int[Array, "few"]:
    """Numbers of `count` different contacts, those that are wanted before the others."""
    all_of_them = wanted.shape[0]
    place = jnp.arange(all_of_them)
    rank = place + all_of_them * ~wanted
    which = []
    for _ in range(count):
        lowest = jnp.min(rank)  # no two are the same, and the rank tells the place: half the work of argmin
        which.append(lowest % all_of_them)
        rank = jnp.where(rank == lowest, 2 * all_of_them, rank)
    return jnp.stack(which)


def _picked(of_all: Float[Array, "contact"], which) -> Float[Array, "few"]:
    """The entries of a few contacts. By a sum: the transpose of an index is a scatter, and XLA compiles no loop with
    one in it into one kernel."""
    return jnp.sum(jnp.where(jnp.arange(of_all.shape[0]) == which[:, None], of_all, 0), axis=1)


def _spread(of_few, which, of_all):
    """The few entries put in their places. By selections: a scatter would be a loop of its own."""
    for k in range(which.shape[0]):
        here = jnp.arange(of_all.shape[0]) == which[k]
        of_all = jnp.where(here.reshape(-1, *[1] * (of_all.ndim - 1)), of_few[k], of_all)
    return of_all
