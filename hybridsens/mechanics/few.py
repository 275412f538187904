"""The few contacts that matter at an instant, out of many: laws are worked out among them alone."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .scene import AbstractScene
from .typed import WrappedScene

FEW = 2
"""How many contacts can matter at an instant before all are looked at."""
MANY = 8
"""Scenes of up to this many contacts look at all of them: two copies of a law would take longer to compile than is
gained."""


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


def among_few(
    scene: AbstractScene,
    wanted: Bool[Array, "contact"],
    run: Callable[[AbstractScene, Any], tuple[Any, Any]],
    by_contact: Any,
    elsewhere: Any,
) -> tuple[Any, Any]:
    """`run(scene, by_contact)`, with the wanted contacts alone where they are few.

    `run` returns (what it says of each contact, the rest). Of the contacts that were left out `elsewhere` is said.
    Where more than `FEW` of more than `MANY` contacts are wanted, all are looked at: nothing is left out that matters.
    """
    if wanted.shape[0] <= MANY:
        return run(scene, by_contact)
    who = _first(wanted)

    def few():
        found, rest = run(SomeContacts(scene, who), jax.tree.map(lambda leaf: leaf[who], by_contact))
        return jax.tree.map(lambda of_few, of_all: _spread(of_few, who, of_all), found, elsewhere), rest

    return lax.cond(jnp.sum(wanted) <= FEW, few, lambda: run(scene, by_contact))


def _first(wanted: Bool[Array, "contact"]) -> Int[Array, "few"]:
    """Numbers of `FEW` different contacts, those that are wanted before the others."""
    count = wanted.shape[0]
    place = jnp.arange(count)
    rank = place + count * ~wanted
    who = []
    for _ in range(FEW):
        who.append(jnp.argmin(rank))
        rank = jnp.where(place == who[-1], 2 * count, rank)
    return jnp.stack(who)


def _picked(of_all: Float[Array, "contact"], who) -> Float[Array, "few"]:
    """The entries of a few contacts. By a sum: the transpose of an index is a scatter, and XLA compiles no loop with
    one in it into one kernel."""
    return jnp.sum(jnp.where(jnp.arange(of_all.shape[0]) == who[:, None], of_all, 0), axis=1)


def _spread(of_few, who, of_all):
    """The few entries put in their places. By selections: a scatter would be a loop of its own."""
    for k in range(FEW):
        of_all = jnp.where(jnp.arange(of_all.shape[0]) == who[k], of_few[k], of_all)
    return of_all
