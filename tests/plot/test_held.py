"""Forces of held contacts against balances of forces; none in flight, however short."""

import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import hybridsens as hs


class BesideAWall(hs.AbstractScene):
    """A mass above a floor, pushed by a force that jumps at t = 1/2; far away another wall."""

    push: Array
    far: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.where(t < 0.5, -1.0, self.push)[None]

    def gap(self, t, q):
        return jnp.stack([q[0], self.far - q[0]])

    def restitution(self):
        return jnp.array([0.8, 0.8])


@pytest.fixture(scope="module")
def cascade():
    """A ball that is captured after some thirty impacts."""
    ball = hs.scenes.BouncingBall()
    return ball, hs.simulate(ball, ball.initial_state(), t1=6.0, ts=jnp.linspace(0, 6, 31))


def test_between_impacts_nothing_is_held(cascade):
    ball, motion = cascade
    t, force = hs.contact_forces(ball, motion)
    last = float(motion.events.time[int(motion.events.count) - 1])
    assert int(motion.events.count) > 20 and not np.any(force[t < last])
    np.testing.assert_allclose(force[t > last], 9.81, rtol=1e-12)


def test_bars_are_drawn_of_closed_contacts_alone(cascade):
    """One from the capture on; none between impacts."""
    ball, motion = cascade
    last = float(motion.events.time[int(motion.events.count) - 1])
    bars = hs.plot_trajectory(ball, motion).axes[2].collections[0].get_paths()
    drawn = sorted((path.vertices[:, 0].min(), path.vertices[:, 0].max()) for path in bars)
    np.testing.assert_allclose(drawn[0][0], last, rtol=1e-12)
    np.testing.assert_allclose(sum(end - start for start, end in drawn), 6 - last, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("far", (1.0, 1e6))
def test_a_force_that_jumps_lets_go_and_a_far_wall_changes_nothing(far):
    """Held by a weight of 1 until the force pulls, without an event; at the jump the force is that after it."""
    scene = BesideAWall(jnp.array(2.0), jnp.array(far))
    motion = hs.simulate(scene, hs.State([0.0], [0.0]), t1=0.9, ts=jnp.linspace(0, 0.9, 10), jump_ts=jnp.array([0.5]))
    t, force = hs.contact_forces(scene, motion)
    np.testing.assert_allclose(force[:, 0], np.where(t < 0.5, 1.0, 0.0), atol=1e-12)
    assert not np.any(force[:, 1])


@pytest.mark.slow
def test_hops_that_are_small_beside_a_far_wall_are_flights():
    scene = BesideAWall(jnp.array(-1.0), jnp.array(1e5))
    times = dict(t1=0.03, ts=jnp.linspace(0, 0.03, 41), jump_ts=jnp.array([0.5]))
    motion = hs.simulate(scene, hs.State([1e-4], [0.0]), **times)
    assert int(motion.events.count) == 1 and not np.any(hs.contact_forces(scene, motion)[1])


@pytest.mark.slow
def test_feet_of_a_block_carry_its_weight_together():
    """At rest from the start, where every gap is rounding. Three of four feet are independent: those that the motion
    holds, also where one of them carries nothing."""
    block = hs.scenes.FootedBlock(4, 0.0, 0.0, 0.0)
    motion = hs.simulate(block, block.initial_state(), t1=1.0, ts=jnp.linspace(0, 1, 5))
    _, force = hs.contact_forces(block, motion)
    np.testing.assert_allclose(force.sum(axis=1), 9.81, rtol=1e-12)
    assert np.all(force >= 0) and not np.any(force[:, ~np.asarray(motion.mode)])


class OnAFloor(hs.AbstractSwitchedScene):
    """A mass that is pulled up from a floor by a motor: of 3 N until t = 1/2, then of 8 N, then of 20 N."""

    event_names = ("second gear", "third gear")

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return jnp.array([3.0, 8.0, 20.0])[mode][None] - 10

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.array([0.5])

    def switches(self, t, q, v, mode):
        return jnp.stack([0.5 - t, 0.8 - t])

    def switch(self, event, t, q, v, mode):
        return v, event + 1


def test_forces_follow_the_mode_and_its_switches_have_names():
    scene = OnAFloor()
    motion = hs.simulate(scene, hs.State([0.0], [0.0]), jnp.array(0), t1=1.0, ts=jnp.linspace(0, 1, 11))
    t, force = hs.contact_forces(scene, motion)
    assert t[5:7].tolist() == [0.5, 0.5]  # before the switch and after it
    np.testing.assert_allclose(force[:, 0], [*[7.0] * 6, *[2.0] * 5, *[0.0] * 4], atol=1e-12)
    assert motion.events.to_pandas().contact.tolist() == ["second gear", "third gear"]
    assert "second gear" in str(motion) and hs.plot_contacts(scene, motion).axes
