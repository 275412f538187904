"""A plate on many feet: the Delassus matrix by its factors says what the whole one says, at events and on the way."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics import contact
from hybridsens.mechanics.contact import contact_geometry
from hybridsens.mechanics.mode import open_mode
from hybridsens.mechanics.system import ImpactReport, MechanicalSystem
from tests.closeness import assert_close
from tests.problems.flat_contacts import plate, run

DOF, COUNT = 3, 14
CLOSED = [(3,), (3, 8), (0, 1), (2, 5, 9), (1, 4, 6, 12), tuple(range(COUNT))]
"""Feet that are on the floor at an instant, the first and the second one of them at the same place; up to all."""


def feet():
    """Places of feet, a pair among them equal; in whole tenths, so that some of them lie in line."""
    random = np.random.default_rng(3)
    places = np.column_stack([np.ones(COUNT), random.integers(-9, 10, (COUNT, 2)) / 10])
    places[1] = places[0]
    return places


def falling(closed, e):
    """A plate whose feet are too short by some centimetres, but for those on the floor."""
    short = np.random.default_rng(len(closed)).uniform(0.01, 0.1, COUNT)
    short[list(closed)] = 0.0
    return eqx.tree_at(lambda scene: scene.offsets, plate(feet(), e), jnp.array(short))


def one_event(event, scene, x):
    """Decision and reset at an event, and the derivative of what comes out by scene and state."""

    def after(scene, x):
        system = MechanicalSystem(scene, None, 1e-5, DOF, (1e-8, 1e-8))
        decision = system.decide(event, jnp.array(0.3), x, open_mode(COUNT, x.dtype))
        return system.reset(decision, jnp.array(0.3), x), decision

    (x_after, report), pull, decision = jax.vjp(after, scene, x, has_aux=True)
    bound = jnp.minimum(decision.first_step_bound, 1e3)
    told = decision.kind, decision.detail, decision.mode.active, bound, decision.order_matters
    weights = jnp.cos(jnp.arange(2.0 * DOF)), ImpactReport(jnp.cos(jnp.arange(1.0 * COUNT)), jnp.array(1.0))
    return x_after, report, told, pull(weights)


def leaves(tree):
    return [np.asarray(leaf, float) for leaf in jax.tree.leaves(tree)]


def test_the_matrix_is_kept_by_its_factors_where_contacts_are_many():
    """None of n^2 entries: 14 feet of a plate; and all of it where four of them are."""
    given = jnp.array(0.0), jnp.zeros(DOF)
    assert contact_geometry(falling((3,), 0.5), *given).delassus.rows.shape == (COUNT, DOF)
    assert contact_geometry(plate(feet()[:4], 0.5), *given).delassus.rows.shape == (4, 4)


@pytest.mark.slow
def test_laws_by_factors_are_those_by_the_whole_matrix(monkeypatch):
    """Who takes part, impulses, velocities after, and their derivatives."""
    x = jnp.array([0.0, 0.0, 0.0, -1.0, 0.3, -0.2])
    given = [(jnp.array(closed[0]), falling(closed, e), x) for closed in CLOSED for e in (0.0, 0.8)]
    given.append((jnp.array(-1), falling(CLOSED[-1], 0.5), x.at[3:].set(0.0)))  # all feet on the floor at the start
    by_factors = jax.jit(lambda *given: one_event(*given))
    found = [by_factors(*of) for of in given]
    monkeypatch.setattr(contact, "FEW", COUNT)
    whole = jax.jit(lambda *given: one_event(*given))
    for of, one in zip(given, found, strict=True):
        assert of[0] < 0 or bool(jnp.any(one[1].impulse > 0))
        for ours, other in zip(leaves(one), leaves(whole(*of)), strict=True):
            assert_close(ours, other, 1e-11, scale=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_plate_on_many_feet_dropped_flat_stays_flat_and_rests(e):
    """No tilt, no penetration, rest; it is held by feet that are independent."""
    motion = run(plate(feet(), e), [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], 2.0)
    assert motion.status == hs.Status.successful
    assert 1 <= int(jnp.sum(motion.mode)) <= DOF
    assert_close(motion.final.q, np.zeros(DOF), 1e-12, scale=1.0)
    assert_close(motion.final.v, np.zeros(DOF), 1e-12, scale=1.0)


@pytest.mark.slow
def test_a_motion_by_factors_is_that_by_the_whole_matrix(monkeypatch):
    """A tilted plate bounces from foot to foot and comes to rest; with its gradient."""

    def cost(scene):
        state = hs.State(jnp.array([0.3, 0.1, -0.07]), jnp.zeros(DOF))
        motion = hs.simulate(
            scene, state, t1=1.5, running_cost=lambda s, t, q, v: q @ q, throw=False, max_steps=2048, max_events=256
        )
        return motion.cost, motion

    scene = plate(feet(), 0.4)
    differentiated = lambda: eqx.filter_jit(eqx.filter_value_and_grad(lambda scene: cost(scene), has_aux=True))
    (found, motion), gradient = differentiated()(scene)
    assert motion.status == hs.Status.successful and motion.events.count > 10
    monkeypatch.setattr(contact, "FEW", COUNT)
    (expected, of_all), gradient_of_all = differentiated()(scene)
    assert motion.events.count == of_all.events.count
    assert_close(found, expected, 1e-11)
    for one, other in zip(leaves(gradient), leaves(gradient_of_all), strict=True):
        assert_close(one, other, 1e-7)
