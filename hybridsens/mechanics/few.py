"""The few contacts that matter at an instant, out of many: laws are worked out among them alone."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .scene import AbstractScene
from .typed import WrappedScene

MANY = 8
"""Scenes of up to this many contacts look at all of them."""


class SomeContacts(WrappedScene):
    """A scene with some of its contacts; the others are not there."""

    scene: AbstractScene
    who: Int[Array, "few"]

    def mass_matrix(self, q):
        return self.scene.mass_matrix(q)

    def force(self, t, q, v):
        return self.scene.force(t, q, v)

    def gap(self, t, q):
        return _picked(self.scene.gap(t, q), self.who)

    def restitution(self):
        return _picked(self.scene.restitution(), self.who)


class Among(NamedTuple):
    """What is worked out among contacts, and what is said of those that are left out."""

    run: Callable[[AbstractScene, Any], tuple[Any, Any]]
    """(scene, by_contact) -> what it says of each contact, and the rest."""
    by_contact: Any
    elsewhere: Any


def among_one(scene: AbstractScene, wanted: Bool[Array, "contact"], among: Among) -> tuple[Any, Any]:
    """`among.run` with the one contact that is wanted; with all of them where several are: nothing is left out that
    matters.

    A law for one contact is short. For two it would take as long to compile as for all."""
    if wanted.shape[0] <= MANY:
        return among.run(scene, among.by_contact)
    # On the way back each branch is worked out again. Otherwise the matrices of all contacts would be handed on, as
    # zeros, where one of them was looked at.
    alone = jax.checkpoint(lambda: _among_first(scene, wanted, 1, among))
    together = jax.checkpoint(lambda: among.run(scene, among.by_contact))
    return lax.cond(jnp.sum(wanted) <= 1, alone, together)


def among_held(scene: AbstractScene, held: Bool[Array, "contact"], dof: int, among: Among) -> tuple[Any, Any]:
    """The same with the contacts that are held. These are independent, so that there are at most as many of them as
    coordinates: a body of few coordinates needs no more, however many contacts it has."""
    if held.shape[0] > MANY and dof <= MANY:
        return _among_first(scene, held, dof, among)
    return among_one(scene, held, among)


def _among_first(scene: AbstractScene, wanted, count: int, among: Among) -> tuple[Any, Any]:
    """With so many contacts, those that are wanted before the others."""
    who = _first(wanted, count)
    found, rest = among.run(SomeContacts(scene, who), jax.tree.map(lambda leaf: leaf[who], among.by_contact))
    return jax.tree.map(lambda of_few, of_all: _spread(of_few, who, of_all), found, among.elsewhere), rest


def _first(wanted: Bool[Array, "contact"], count: int) -> Int[Array, "few"]:
    """Numbers of different contacts, those that are wanted before the others."""
    all_of_them = wanted.shape[0]
    place = jnp.arange(all_of_them)
    rank = place + all_of_them * ~wanted
    who = []
    for _ in range(count):
        lowest = jnp.min(rank)  # no two are the same, and the rank tells the place: half the work of argmin
        who.append(lowest % all_of_them)
        rank = jnp.where(rank == lowest, 2 * all_of_them, rank)
    return jnp.stack(who)


def _picked(of_all: Float[Array, "contact"], who) -> Float[Array, "few"]:
    """The entries of a few contacts. By a sum: the transpose of an index is a scatter, and XLA compiles no loop with
    one in it into one kernel."""
    return jnp.sum(jnp.where(jnp.arange(of_all.shape[0]) == who[:, None], of_all, 0), axis=1)


def _spread(of_few, who, of_all):
    """The few entries put in their places. By selections: a scatter would be a loop of its own."""
    for k in range(who.shape[0]):
        of_all = jnp.where(jnp.arange(of_all.shape[0]) == who[k], of_few[k], of_all)
    return of_all
