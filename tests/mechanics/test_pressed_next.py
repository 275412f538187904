"""Bodies whose contacts have no force at an instant: how the forces change tells which are pressed next."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Peg(hs.AbstractScene):
    """A peg in a slot that it fits exactly, pulled to and fro."""

    frequency: jax.Array
    later: jax.Array
    """Whether the pull begins with 1 - cos w t: at the start neither it nor its rate tells a side."""

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        pull = jnp.cos(self.frequency * t)
        return jnp.where(self.later, 1 - pull, pull)[None]

    def gap(self, t, q):
        return jnp.concatenate([q, -q])

    def restitution(self):
        return jnp.full(2, 0.5)


class Beam(hs.AbstractScene):
    """A beam of mass 1 on three feet in a row, the middle one at the centre of percussion of the first: an impulse at
    one does not move the other. q = height and tilt."""

    middle: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(jnp.stack([jnp.ones(()), 0.5 * self.middle]))

    def force(self, t, q, v):
        return jnp.array([-9.81, 0.0])

    def gap(self, t, q):
        return q[0] + jnp.stack([-0.5 * jnp.ones(()), self.middle, 0.5 * jnp.ones(())]) * q[1]

    def restitution(self):
        return jnp.zeros(3)


class Ramps(hs.AbstractScene):
    """Bodies on the floor, each pulled up by r (t - t0)."""

    t0: jax.Array
    r: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(q.shape[0])

    def force(self, t, q, v):
        return self.r * (t - self.t0)

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.zeros(self.r.shape)


@jax.jit
def second_event_and_slope(peg, t1):
    """The motion, and the derivatives of the time of its second event."""

    def second(peg):
        state = hs.State(jnp.zeros(1), jnp.zeros(1))
        trajectory = hs.simulate(peg, state, t1=t1, max_events=32, throw=False)
        return trajectory.events.time[1], trajectory

    slope, trajectory = eqx.filter_grad(second, has_aux=True)(peg)
    return trajectory, slope


@pytest.mark.slow
def test_a_peg_that_fits_exactly_is_handed_from_wall_to_wall():
    """Its force passes from one wall to the other at the zeros of cos w t, and nothing strikes."""
    trajectory, slope = second_event_and_slope(Peg(jnp.array(3.0), jnp.array(False)), 5.0)
    assert trajectory.status == hs.Status.successful
    assert trajectory.events.count == 5
    assert (trajectory.events.kind[:5] == hs.EventKind.RELEASE).all()
    assert_close(trajectory.events.time[:5], (np.arange(5) + 0.5) * np.pi / 3, 1e-11)
    np.testing.assert_allclose(trajectory.final.q, np.zeros(1), atol=1e-14)
    assert_close(slope.frequency, -1.5 * np.pi / 9, 1e-9)


def test_a_pull_that_begins_smoothly_presses_a_peg_in_its_slot():
    trajectory, _ = second_event_and_slope(Peg(jnp.array(3.0), jnp.array(True)), 2.0)
    assert trajectory.status == hs.Status.successful
    np.testing.assert_allclose(trajectory.final.q, np.zeros(1), atol=1e-12)


@pytest.mark.slow
def test_a_beam_comes_down_on_all_its_feet():
    """It falls about one end; the foot in the middle closes too, though the impulse at the other end does not act on
    it: the end that it turns about does. About that end I a'' = m g / 2 with I = J + m / 4."""
    scene, tilt = Beam(jnp.asarray(0.2)), 0.1
    state = hs.State(jnp.array([tilt / 2, -tilt]), jnp.zeros(2))
    trajectory = jax.jit(lambda scene: hs.simulate(scene, state, t1=1.0, max_events=8, throw=False))(scene)
    assert trajectory.status == hs.Status.successful and trajectory.events.count == 1
    assert_close(trajectory.events.time[0], np.sqrt(2 * tilt * (0.1 + 0.25) / (9.81 / 2)), 1e-9)
    np.testing.assert_allclose(trajectory.final.q, np.zeros(2), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("apart", [0, 8, 32, 100, 1000])
def test_bodies_let_go_within_roundings_of_each_other(apart):
    """At t they are at r (t - t0)^3 / 6."""
    rng = np.random.default_rng(apart)
    state = hs.State(jnp.zeros(4), jnp.zeros(4))
    run = jax.jit(lambda scene: hs.simulate(scene, state, t1=2.0, max_events=16, throw=False))
    for _ in range(10):
        t0 = 0.8 + np.spacing(0.8) * rng.integers(0, apart + 1, 4)
        r = 10 ** rng.uniform(-2, 2, 4)
        trajectory = run(Ramps(jnp.asarray(t0), jnp.asarray(r)))
        assert trajectory.status == hs.Status.successful
        assert_close(trajectory.final.q, r * 1.2**3 / 6, 1e-9)
