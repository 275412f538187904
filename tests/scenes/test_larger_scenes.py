"""Scenes of any size, at small ones: conservation, closed forms, and laws among few contacts against all of them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics import contact
from hybridsens.mechanics.mode import open_mode
from hybridsens.mechanics.system import ImpactReport, MechanicalSystem
from hybridsens.scenes import BallsInBox, ChainOfMasses, DoublePendulumWall, FootedBlock, LinkPendulum, NewtonsCradle
from tests.closeness import assert_close

ROOM = dict(max_steps=1024, max_events=64, rtol=1e-9, atol=1e-9)


def cost_and_motion(scene, t1):
    """int q.q, and the motion."""
    motion = hs.simulate(
        scene, scene.initial_state(), t1=t1, running_cost=lambda s, t, q, v: q @ q, throw=False, **ROOM
    )
    return motion.cost, motion


value_and_grad = eqx.filter_jit(eqx.filter_value_and_grad(cost_and_motion, has_aux=True))


def kinetic_energy(scene, state):
    mass = scene.mass_matrix(state.q)
    return state.v @ (mass.mv(state.v) if isinstance(mass, lx.AbstractLinearOperator) else mass @ state.v) / 2


TOUCHING = [(3,), (8,), (3, 4), (3, 6), (2, 3, 4), tuple(range(9))]
"""Contacts of a chain of nine that are closed at an instant, up to all of them."""


def chain_with_closed(closed):
    """A state with these gaps at 0 and masses that come together, all others open."""
    random = np.random.default_rng(sum(closed))
    gap = random.uniform(0.1, 0.5, 9)
    gap[list(closed)] = 0.0
    return np.concatenate([np.cumsum((0.6 - gap)[::-1])[::-1], np.sort(random.uniform(0.1, 1.0, 9))[::-1]])


def one_event(event, x, restitution):
    """Decision and reset at an event, and the derivative of what comes out by state and restitution."""

    def after(x, restitution):
        scene = ChainOfMasses(9, restitution_coefficient=restitution)
        system = MechanicalSystem(scene, None, 1e-5, 9, (1e-8, 1e-8))
        decision = system.decide(event, jnp.array(0.3), x, open_mode(9, x.dtype))
        return system.reset(decision, jnp.array(0.3), x), decision

    (x_after, report), pull, decision = jax.vjp(after, x, restitution, has_aux=True)
    bound = jnp.minimum(decision.first_step_bound, 1e3)
    told = decision.kind, decision.detail, decision.mode.active, bound, decision.order_matters
    return x_after, report, told, pull((jnp.cos(jnp.arange(18.0)), ImpactReport(jnp.ones(9), jnp.array(1.0))))


@pytest.mark.slow
def test_laws_among_few_contacts_are_those_among_all(monkeypatch):
    """Who takes part, impulses, velocities after, and their derivatives: one contact alone, or all nine."""
    given = [
        (jnp.array(closed[0]), jnp.array(chain_with_closed(closed)), jnp.array(e))
        for closed in TOUCHING
        for e in (0.0, 0.8)
    ]
    run = jax.jit(lambda *given: one_event(*given))
    among_few = [run(*x) for x in given]
    monkeypatch.setattr(contact, "FEW", 9)
    run_all = jax.jit(lambda *given: one_event(*given))
    for x, found in zip(given, among_few, strict=True):
        assert bool(jnp.any(found[1].impulse > 0))
        for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(run_all(*x)), strict=True):
            assert_close(np.asarray(one, float), np.asarray(other, float), 1e-11, scale=1.0)


@pytest.mark.slow
def test_a_motion_among_few_contacts_is_that_among_all(monkeypatch):
    """A chain of nine looks at one contact alone where it can; told to look at all, it moves the same, to rounding."""
    scene = ChainOfMasses(contact.FEW + 1)
    (cost, motion), gradient = value_and_grad(scene, 6.0)
    assert motion.status == hs.Status.successful and motion.events.count > 10
    monkeypatch.setattr(contact, "FEW", scene.mass.shape[0])
    (cost_of_all, motion_of_all), gradient_of_all = eqx.filter_jit(
        eqx.filter_value_and_grad(lambda scene, t1: cost_and_motion(scene, t1), has_aux=True)
    )(scene, 6.0)
    assert motion.events.count == motion_of_all.events.count
    assert_close(cost, cost_of_all, 1e-12)
    for one, other in zip(jax.tree.leaves(gradient), jax.tree.leaves(gradient_of_all), strict=True):
        assert_close(one, other, 1e-9)
    h = 1e-5
    ends = [cost_of(eqx.tree_at(lambda s: s.clearance, scene, scene.clearance + x), 6.0) for x in (h, -h)]
    assert_close(gradient.clearance, (ends[0] - ends[1]) / (2 * h), 1e-6)


def cost_of(scene, t1):
    return value_and_grad(scene, t1)[0][0]


@pytest.mark.slow
def test_the_last_ball_of_a_cradle_rises_as_high_as_the_first_one_fell():
    """At half a period, up to the clearance; energy to rounding."""
    scene = NewtonsCradle(4, clearance=1e-6)
    _, motion = eqx.filter_jit(cost_and_motion)(scene, jnp.pi)
    assert motion.status == hs.Status.successful and list(motion.events.contact[:3]) == [0, 1, 2]
    assert_close(motion.final.q, np.array([0, 0, 0, scene.pulled]), 1e-5, scale=1.0)


def test_balls_in_a_box_have_names_and_outlines():
    """The gap of each name is that of what it names, and outlines touch where a gap is zero."""
    scene = BallsInBox(3, radius=0.5, mass=[1.0, 2.0, 5.0])
    q = jnp.array([-1.5, 0.0, -0.5, 0.0, 0.6, -1.5])  # the first is at the left wall and at the second, the last below
    touching = {name for name, gap in zip(scene.contacts, scene.gap(0.0, q), strict=True) if abs(gap) < 1e-12}
    assert touching == {"balls 0-1", "ball 0 left", "ball 2 bottom"} and scene.mass[2] == 5.0
    box, first, second, last = scene.draw(q)
    assert first[:, 0].min() == box[:, 0].min() and last[:, 1].min() == box[:, 1].min()
    assert abs(first[:, 0].max() - second[:, 0].min()) < 1e-12
    with pytest.raises(ValueError, match=r"for each of 3 balls, but has shape \(2,\)"):
        BallsInBox(mass=[1.0, 2.0])


@pytest.mark.slow
def test_balls_in_a_box_keep_their_energy_and_between_walls_their_momentum():
    """Elastic; momentum changes at walls alone, along their normal, by the impulse that is reported."""
    scene = BallsInBox(3, radius=0.6)
    _, motion = eqx.filter_jit(cost_and_motion)(scene, 4.0)
    count, events = int(motion.events.count), motion.events
    assert motion.status == hs.Status.successful and {int(c) < 3 for c in events.contact[:count]} == {True, False}
    start = scene.initial_state()
    assert_close(kinetic_energy(scene, motion.final), kinetic_energy(scene, start), 1e-13)
    momentum = lambda v: (jnp.repeat(scene.mass, 2) * v).reshape(*v.shape[:-1], 3, 2).sum(-2)
    change = momentum(events.after.v) - momentum(events.before.v)
    by_walls = (events.impulse[:, 3:9] - events.impulse[:, 9:]).reshape(-1, 3, 2).sum(1)
    assert_close(change[:count], by_walls[:count], 1e-13, scale=1.0)


@pytest.mark.slow
def test_a_pendulum_of_two_links_is_the_double_pendulum():
    """The same motion by two ways of writing it, through impacts of both."""
    links = eqx.tree_at(lambda s: (s.mass, s.length), LinkPendulum(2), (jnp.array([1.0, 0.5]), jnp.array([1.0, 0.7])))
    double = DoublePendulumWall(rotor_inertia=0.0, angle_lower=-0.8)
    ends = [eqx.filter_jit(cost_and_motion)(scene, 2.0)[1] for scene in (links, double)]
    assert ends[0].events.count == ends[1].events.count > 0
    assert_close(ends[0].final.q, ends[1].final.q, 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("unevenness", [0.0, 0.01])
def test_a_block_comes_to_rest_on_ten_feet(unevenness):
    """Even: level, on all feet. Uneven: still, above the floor, and touching it with three feet at least."""
    scene = FootedBlock(10, unevenness)
    _, motion = on_feet(scene, 3.0)
    gap = scene.gap(0.0, motion.final.q)
    assert motion.status == hs.Status.successful
    assert_close(motion.final.v, np.zeros(3), 1e-9, scale=1.0)
    assert float(jnp.min(gap)) > -1e-9
    assert int(jnp.sum(gap < 1e-9)) == 10 if unevenness == 0 else int(jnp.sum(gap < 1e-9)) >= 3


on_feet = eqx.filter_jit(cost_and_motion)
