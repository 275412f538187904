"""A light body between two that come together is struck by both in turn, ever faster: by infinitely many impacts in a
finite time, or by so many that these bodies part again. Against the same impacts in many digits."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

GRAVITY = 9.81
LOW, HIGH = 0.4, 0.45


class Anvil(hs.AbstractScene):
    """A heavy block falls on a light one that falls on the floor."""

    light: jax.Array
    heavy: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(jnp.stack([self.light, self.heavy]))

    def force(self, t, q, v):
        return -GRAVITY * jnp.stack([self.light, self.heavy])

    def gap(self, t, q):
        return jnp.stack([q[0], q[1] - q[0]])

    def restitution(self):
        return jnp.stack([self.e, self.e])


def impact_by_impact(light, heavy, e, end):
    """Heights and velocities at `end`, by parabolas in 60 digits; at rest on the floor once the blocks are slower than
    1e-15 m/s."""
    with mp.workdps(60):
        light, heavy, e, g = map(mp.mpf, (light, heavy, e, GRAVITY))
        t, (low, high), (v, w) = mp.mpf(0), (mp.mpf(LOW), mp.mpf(HIGH)), (mp.mpf(0), mp.mpf(0))
        while max(abs(v), abs(w)) > 1e-15 or t == 0:
            root = mp.sqrt(v * v + 2 * g * low)
            on_floor = (v + root) / g if v > 0 else 2 * low / (root - v)
            on_block = (high - low) / (v - w) if v > w else mp.inf
            step = min(on_floor, on_block, end - t)
            low, high = low + v * step - g * step**2 / 2, high + w * step - g * step**2 / 2
            t, v, w = t + step, v - g * step, w - g * step
            if t >= end:
                return np.array([float(x) for x in (low, high, v, w)])
            if on_floor < on_block:
                low, v = mp.mpf(0), -e * v
            else:
                impulse = (1 + e) * (v - w) * light * heavy / (light + heavy)
                high, v, w = low, v - impulse / light, w + impulse / heavy
        return np.zeros(4)


def fallen(light, heavy, e, end, tolerance=1e-8):
    scene = Anvil(*(jnp.asarray(x) for x in (light, heavy, e)))
    start = hs.State(jnp.array([LOW, HIGH]), jnp.zeros(2))
    return hs.simulate(scene, start, t1=end, rtol=tolerance, atol=tolerance, max_events=512)


@pytest.mark.parametrize(
    "light, heavy, e", [(0.05, 1.0, 0.3), (0.05, 1.0, 0.5), (0.1, 1.0, 0.3), (0.2, 1.0, 0.2), (1.0, 1.0, 0.1)]
)
def test_two_that_come_together_rest_with_what_is_between_them(light, heavy, e):
    """In truth by 89 to 911 impacts. Those less than some 1e-11 m apart were taken for simultaneous ones: in the first
    case the heavy block was thrown up at 0.4 m/s, in silence."""
    assert np.all(impact_by_impact(light, heavy, e, 0.32) == 0)
    motion = fallen(light, heavy, e, 0.32)
    assert motion.status == hs.Status.successful
    assert_close(jnp.concatenate([motion.final.q, motion.final.v]), np.zeros(4), 1e-13, scale=1.0)
    slope = jax.grad(lambda e: fallen(light, heavy, e, 0.32).final.q[1])(e)
    assert abs(slope) < 1e-13


@pytest.mark.parametrize("e, impacts", [(0.8, 14), (0.7, 21), (0.68, 28)])
def test_they_part_again_where_the_light_one_is_elastic_enough(e, impacts):
    motion = fallen(0.05, 1.0, e, 0.31)
    assert motion.events.count == impacts and not jnp.any(motion.events.order_matters)
    assert_close(jnp.concatenate([motion.final.q, motion.final.v]), impact_by_impact(0.05, 1.0, e, 0.31), 1e-12)


def test_more_impacts_than_there_is_room_for_are_told():
    """The heavy block loses a hundredth of its speed with every impact: thousands come in less than the clock shows."""
    with pytest.raises(hs.SimulationError, match="max_events"):
        fallen(0.001, 1.0, 0.6, 0.32)


class Collapse(hs.AbstractScene):
    """A light body between two that come together, and no force at all."""

    masses: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(self.masses)

    def force(self, t, q, v):
        return jnp.zeros(3)

    def gap(self, t, q):
        return jnp.stack([q[1] - q[0] + 0.2, q[2] - q[1] + 0.3])

    def restitution(self):
        return jnp.stack([self.e, self.e])


def test_without_a_load_they_go_on_together():
    """All with the velocity of the centre of mass. Once one was slower than ten times what is captured, both were taken
    for simultaneous, with a rebound: they drifted apart at up to 1e-3 of their speed."""
    masses, v = jnp.array([1.0, 0.1, 1.5]), jnp.array([0.7, 0.05, -0.8])

    def after(scene):
        motion = hs.simulate(scene, hs.State(jnp.zeros(3), v), t1=1.2, max_events=512)
        return motion.final.v, scene.gap(0.0, motion.final.q)

    (velocities, gaps), by = after(Collapse(masses, jnp.array(0.2))), jax.jacrev(lambda s: after(s)[0])
    common = masses @ v / jnp.sum(masses)
    assert_close(velocities, jnp.full(3, common), 1e-12)
    assert_close(gaps, np.zeros(2), 1e-12, scale=1.0)
    slopes = by(Collapse(masses, jnp.array(0.2)))
    assert_close(slopes.masses, jnp.tile((v - common) / jnp.sum(masses), (3, 1)), 1e-10)
    assert_close(slopes.e, np.zeros(3), 1e-10, scale=1.0)
