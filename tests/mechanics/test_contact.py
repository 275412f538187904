"""Contacts that close, hold, strike again and let go: closed forms for what Gauss's and Newton's laws say."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk

import hybridsens as hs
from hybridsens.scenes import BouncingBall
from tests.closeness import assert_close
from tests.problems import linear_contacts as linear
from tests.problems import shipped_motions as motions

FLOOR = ([0.0, 1.0, 0.0], 0.0)
WALL = ([-1.0, 0.0, 0.0], 1.0)
SLANT = np.pi / 6
DOWN = ([-np.cos(SLANT), -np.sin(SLANT), 0.0], np.cos(SLANT))
UP = ([-np.cos(SLANT), np.sin(SLANT), 0.0], np.cos(SLANT))
FEET = [([1.0, x, y], 0.0) for x, y in [(1, 1), (-1, 1), (-1, -1), (1, -1)]]
THREE_FEET = [([1.0, x, y], 0.0) for x, y in [(1, 0), (-0.5, 0.8), (-0.5, -0.8)]]
PLATE = dict(force=(-9.81, 0.0, 0.0), mass=(1.0, 0.3, 0.4))


def closed(trajectory):
    return trajectory.mode.tolist()


def raised(contacts, height):
    """The same contacts with the floor at a height of its own."""
    return [(normal, offset - height * normal[0]) for normal, offset in contacts]


@pytest.mark.slow
def test_a_wall_is_struck_while_the_floor_is_held():
    """A body slides on the floor, strikes a wall, slides back: x(2) = c - e (2 v - c), and the floor never lets go."""
    motion = linear.solve(linear.scene([FLOOR, WALL], [0.0, 0.8]), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 2.0)
    assert motion.trajectory.events.count == 1
    assert closed(motion.trajectory) == [True, False, False, False]
    assert_close(motion.trajectory.final.q, [0.2, 0.0, 0.0], 1e-12)
    assert_close(motion.by_scene.e[0, 1], -1.0, 1e-12)
    assert_close(motion.by_scene.offsets[0, 1], 1.8, 1e-12)
    assert_close(motion.by_state.v[0, 0], -1.6, 1e-12)


@pytest.mark.slow
def test_an_impact_presses_on_a_held_contact():
    """A wall that leans over: the floor's impulse answers the wall's, and the body slides straight back."""
    motion = linear.solve(linear.scene([FLOOR, DOWN], [0.0, 0.8]), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 2.0)
    impulse = 1.8 / np.cos(SLANT)
    assert_close(motion.trajectory.events.impulse[0, :2], [impulse * np.sin(SLANT), impulse], 1e-12)
    assert_close(motion.trajectory.final.v, [-0.8, 0.0, 0.0], 1e-12)
    assert closed(motion.trajectory)[0]
    assert_close(motion.by_scene.e[0, 1], -1.0, 1e-10)


@pytest.mark.slow
def test_an_impact_lifts_a_body_off_a_held_contact():
    """A wall that leans back throws the body up: the held floor opens at the impact, without an impulse of its own."""
    motion = linear.solve(linear.scene([FLOOR, UP], [0.0, 0.8]), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.1)
    speed = 1.8 * np.cos(SLANT)
    vx, vy = 1 - speed * np.cos(SLANT), speed * np.sin(SLANT)
    assert_close(motion.trajectory.events.impulse[0, :2], [0.0, speed], 1e-12)
    assert_close(motion.trajectory.final.q[:2], [1 + 0.1 * vx, 0.1 * vy - 0.05], 1e-12)
    assert not any(closed(motion.trajectory))


@pytest.mark.slow
def test_orthogonal_walls_are_struck_at_once():
    """In a corner of orthogonal walls impacts commute, so that value and derivative exist: x(2) = -e (x0 + 2 v)."""
    corner = [([1.0, 0.0, 0.0], 0.0), ([0.0, 1.0, 0.0], 0.0)]
    scene = linear.scene(corner, [0.5, 0.8], force=(0.0, 0.0, 0.0))
    motion = linear.solve(scene, [1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], 2.0)
    assert motion.trajectory.events.count == 2
    assert_close(motion.trajectory.events.time[:2], [1.0, 1.0], 1e-12)
    assert_close(motion.trajectory.final.q, [0.5, 0.8, 0.0], 1e-12)
    assert_close(motion.by_state.q[:2, :2], np.diag([-0.5, -0.8]), 1e-12)
    assert_close(motion.by_state.v[:2, :2], np.diag([-1.0, -1.6]), 1e-12)


@pytest.mark.slow
def test_a_ball_strikes_two_that_touch():
    """Newton-Moreau's law (T3) for a row of equal balls: v+ = (-1/3, 2/3, 2/3), which keeps momentum and energy."""
    row = [([-1.0, 1.0, 0.0], 0.0), ([0.0, -1.0, 1.0], 0.0)]
    scene = linear.scene(row, [1.0, 1.0], force=(0.0, 0.0, 0.0))
    motion = linear.solve(scene, [1.0, 2.0, 2.0], [1.0, 0.0, 0.0], 1.5)
    assert motion.trajectory.events.count == 1
    assert_close(motion.trajectory.events.impulse[0, :2], [4 / 3, 2 / 3], 1e-12)
    assert_close(motion.trajectory.final.v, [-1 / 3, 2 / 3, 2 / 3], 1e-12)


@pytest.mark.parametrize("height", [0.0, 0.7], ids=["at 0", "elsewhere"])
@pytest.mark.slow
def test_capture_and_slide_on_an_incline(height):
    """A ball dropped on an incline with e = 0 keeps its speed along it, and slides on with g sin(slope)."""
    normal = [np.sin(SLANT), np.cos(SLANT), 0.0]
    scene = linear.scene([(normal, -height * np.cos(SLANT))], [0.0])
    motion = linear.solve(scene, [0.0, 1.0 + height, 0.0], [0.0, 0.0, 0.0], 1.5)

    def x(g):
        t = 1.5 - jnp.sqrt(2 / g)
        return jnp.cos(SLANT) * (jnp.sqrt(2 * g) * jnp.sin(SLANT) * t + g * jnp.sin(SLANT) * t**2 / 2)

    assert motion.trajectory.events.kind[0] == hs.EventKind.CAPTURE
    assert_close(motion.trajectory.final.q[0], x(10.0), 1e-10)
    assert_close(-motion.by_scene.load[0, 1], jax.grad(x)(10.0), 1e-9)


@pytest.mark.parametrize("height", [0.0, 0.7], ids=["floor at 0", "floor elsewhere"])
@pytest.mark.parametrize("feet", [THREE_FEET, FEET], ids=["three feet", "four feet"])
def test_a_plate_stands_on_its_feet(feet, height):
    """Forces on four feet are not unique (W is singular), but the motion is: the plate stays."""
    scene = linear.scene(raised(feet, height), [0.5] * len(feet), **PLATE)
    motion = linear.solve(scene, [height, 0.0, 0.0], [0.0, 0.0, 0.0], 2.0)
    assert motion.trajectory.events.count == 0
    assert_close(motion.trajectory.final.q, [height, 0.0, 0.0], 1e-12, scale=1.0)
    assert_close(motion.by_scene.load[:, 0], np.zeros(6), 1e-12, scale=1.0)


@pytest.mark.parametrize("height", [0.0, 0.7], ids=["floor at 0", "floor elsewhere"])
@pytest.mark.parametrize("feet", [THREE_FEET, FEET], ids=["three feet", "four feet"])
def test_a_plate_that_falls_flat_bounces_flat(feet, height):
    """All feet strike at once: one event, v+ = -e v-, no tilt."""
    scene = linear.scene(raised(feet, height), [0.5] * len(feet), **PLATE)
    motion = linear.solve(scene, [1.0 + height, 0.0, 0.0], [0.0, 0.0, 0.0], 0.6)
    fall = np.sqrt(2 / 9.81)
    after = 0.6 - fall
    z = height + 0.5 * 9.81 * fall * after - 9.81 * after**2 / 2
    assert motion.trajectory.events.count == 1
    assert_close(motion.trajectory.final.q, [z, 0.0, 0.0], 1e-10)


class Bowl(hs.AbstractScene):
    """A point mass inside a circle of radius 1, under gravity 1."""

    radius: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -1.0])

    def gap(self, t, q):
        return self.radius - jnp.sqrt(q @ q)[None]

    def restitution(self):
        return jnp.zeros(1)


def test_sustained_contact_does_not_drift():
    """A mass sliding in a bowl is a pendulum: after 20 periods it is where it was, and never left the bowl."""
    angle, tolerance = 1.2, 1e-9
    period = 4 * ellipk(np.sin(angle / 2) ** 2)
    start = jnp.array([np.sin(angle), -np.cos(angle)])
    ts = jnp.linspace(0.0, 20 * period, 500)
    settings = dict(rtol=tolerance, atol=tolerance, max_steps=8192)
    trajectory = hs.simulate(Bowl(jnp.array(1.0)), hs.State(start, jnp.zeros(2)), t1=20 * period, ts=ts, **settings)
    assert trajectory.events.count == 0 and bool(trajectory.mode[0])
    gap = 1 - jnp.linalg.norm(trajectory.q, axis=1)
    rate = jnp.sum(trajectory.q * trajectory.v, axis=1)
    assert float(jnp.max(jnp.abs(gap))) < tolerance
    assert float(jnp.max(jnp.abs(rate))) < tolerance
    assert_close(trajectory.final.q, start, 1e-5)


def test_a_body_that_rises_too_slowly_to_leave_is_at_rest():
    """It begins below the floor by rounding, and would fall back before it is above it: no step could tell."""
    depths, speeds = jnp.meshgrid(-jnp.logspace(-17, -14, 4), jnp.logspace(-13, -8, 6))
    start = hs.State(depths.reshape(-1, 1), speeds.reshape(-1, 1))
    run = lambda state: hs.simulate(BouncingBall(), state, t1=0.5, max_events=4, max_steps=64, throw=False)
    motions = jax.jit(jax.vmap(run))(start)
    assert jnp.all(motions.status == hs.Status.successful) and jnp.all(motions.mode)
    assert_close(motions.final.q, np.zeros((24, 1)), 1e-14, scale=1.0)


def test_rest_forgets_the_past_exactly():
    """After capture a ball is where the floor is: derivatives are exactly 1 by the floor and 0 by everything else."""
    _, jacobian, trajectory = motions.solve(BouncingBall(restitution_coefficient=0.7), 1e-10, 3.0)
    assert bool(trajectory.mode[0])
    by_parameters = dict(zip(motions.names(BouncingBall), np.asarray(jacobian.final.parameters).T, strict=True))
    assert_close(by_parameters.pop("floor"), [1.0, 0.0], 1e-14)
    assert all(np.all(entry == 0) for entry in by_parameters.values()), by_parameters
    assert np.all(np.asarray(jacobian.final.shift) == 0)
    assert np.all(np.asarray(jacobian.final.t1) == 0)
