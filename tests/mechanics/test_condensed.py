"""A scene condensed is the same scene: its functions by fewer equations, its motion and gradient to rounding."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.interval.kind import Kind, kinds
from hybridsens.mechanics.condensed import CondensedScene, condensed
from hybridsens.scenes import BouncingBall
from tests.problems.energies import PAIRS, as_energies

BY_HAND, ENERGIES = PAIRS[0]
T = jnp.array(0.3)


def at_random(scene):
    q, v = np.random.default_rng(2).normal(size=(2, *scene.initial_state().q.shape))
    return T, jnp.asarray(q), jnp.asarray(v)


@pytest.mark.slow
def test_a_scene_of_energies_is_condensed_and_stays_the_same():
    scene = as_energies(ENERGIES, BY_HAND())
    t, q, v = at_random(BY_HAND())
    short = condensed(scene, t, q, v)
    assert isinstance(short, CondensedScene)
    assert {"force", "mass_matrix"} <= dict(short.programs).keys()
    length = lambda scene: len(str(jax.make_jaxpr(lambda: scene.force(t, q, v))()))
    assert length(short) < length(scene) / 2
    for name, given in {"force": (t, q, v), "_load": (t, q, v), "gap": (t, q), "mass_matrix": (q,)}.items():
        np.testing.assert_allclose(getattr(short, name)(*given), getattr(scene, name)(*given), rtol=1e-15, atol=0)


def test_it_stays_differentiable_by_its_leaves():
    scene = as_energies(ENERGIES, BY_HAND())
    t, q, v = at_random(BY_HAND())
    short = condensed(scene, t, q, v)
    force = lambda scene: jnp.sum(scene.force(t, 2 * q, v) ** 2)
    found, right = (jax.tree.leaves(eqx.filter_grad(force)(s)) for s in (short, scene))
    np.testing.assert_allclose(np.array(found), np.array(right), rtol=1e-13, atol=1e-13)
    assert np.abs(np.array(right)).max() > 0.1


def test_what_says_nothing_twice_is_left_as_it_is():
    ball = BouncingBall()
    assert condensed(ball, T, jnp.ones(1), jnp.ones(1)) is ball


class Pulled(ENERGIES):
    """The same with a load from a table."""

    def applied_force(self, t, q, v):
        return jnp.interp(q, jnp.arange(4.0), jnp.array([0.0, 1.0, -1.0, 2.0])) - 0 * v


def test_a_table_keeps_its_bounds():
    """A call of `jnp.interp` stays whole, by which its bounds are known."""
    t, q, v = at_random(BY_HAND())
    short = condensed(as_energies(Pulled, BY_HAND()), t, q, v)
    assert isinstance(short, CondensedScene)
    assert "_load" in dict(short.programs)
    trace = jax.make_jaxpr(lambda q: short._load(t, q, v))(q)
    assert (kinds(trace, [np.full(2, Kind.AFFINE)]) == Kind.CURVED).all()
