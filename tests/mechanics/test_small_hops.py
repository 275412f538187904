"""Releases that rounding blurs, and hops that are hardly larger than it, as of a machine that just lifts off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import hybridsens as hs
from tests.closeness import assert_close


class SprungBody(hs.AbstractScene):
    """A body on a stiff spring of length 1 on a base on the floor, q = their heights. What holds the base down,
    m g - k (q1 - q0 - 1), is a difference of numbers of size k: it falls in stairs of k eps."""

    base: jax.Array
    body: jax.Array
    stiffness: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(jnp.stack([self.base, self.body]))

    def force(self, t, q, v):
        pull = self.stiffness * (q[1] - q[0] - 1)
        return jnp.stack([pull - 9.81 * self.base, -pull - 9.81 * self.body])

    def gap(self, t, q):
        return q[:1]

    def restitution(self):
        return jnp.zeros(1)

    def deflection(self):
        """By which it swings where the base just stays."""
        return (self.base + self.body) * 9.81 / self.stiffness


class Unbalance(hs.AbstractScene):
    """A machine on the floor, of weight 1, with a rotor that pulls it by a sin(w t)."""

    pull: jax.Array
    frequency: jax.Array
    restitution_coefficient: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return (self.pull * jnp.sin(self.frequency * t) - 1)[None]

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.restitution_coefficient[None]


PASSED = (hs.Status.successful.code, hs.Status.grazing.code)


def lift_off(scene, excess, rtol=1e-8, atol=1e-8):
    """Of the base, when the body is let go deeper by so much than it may be; the first event and the status."""
    rest = -scene.body * 9.81 / scene.stiffness
    q = jnp.stack([0 * rest, 1 + rest - scene.deflection() * (1 + excess)])
    t1 = 1.7 * 2 * jnp.pi * jnp.sqrt(scene.body / scene.stiffness)
    motion = hs.simulate(scene, hs.State(q, 0 * q), t1=t1, rtol=rtol, atol=atol, max_events=64, throw=False)
    return motion.events.time[0], (motion.status.code, motion.steps)


def exact_lift_off(scene, excess):
    """The body swings as cos(w t) about its rest, and the base lifts off at -1 / (1 + excess)."""
    return jnp.arccos(-1 / (1 + excess)) * jnp.sqrt(scene.body / scene.stiffness)


lift_off_once = jax.jit(lift_off)
lift_off_and_slope = jax.jit(jax.value_and_grad(lift_off, has_aux=True))
exact_lift_off_and_slope = jax.jit(jax.value_and_grad(exact_lift_off))


@jax.jit
def hop(machine):
    """Two turns of the rotor: the time of the first landing, and how the motion ended."""
    t1 = (4.5 * jnp.pi - 0.5) / machine.frequency
    motion = hs.simulate(machine, hs.State(jnp.zeros(1), jnp.zeros(1)), t1=t1, max_events=64, throw=False)
    return motion.events.time[1], motion.status.code, motion.steps, motion.final.q


def landing(pull, frequency):
    """Of the first hop: it begins at sin(w t) = 1 / a."""
    start = np.arcsin(1 / pull)
    height = lambda s: pull * (np.cos(start) * s - np.sin(start + s) + np.sin(start)) - s**2 / 2  # times w^2
    rise = np.sqrt(2 * (pull - 1))  # the pull is more than the weight for twice as long
    return (start + brentq(height, 2.1 * rise, 10 * rise, xtol=1e-15)) / frequency


@pytest.mark.slow
@pytest.mark.parametrize("decades", [(2, 3), (4, 5), (6, 7), (8, 9)])
def test_a_base_lifts_off_under_a_stiff_spring(decades):
    """Assert that of random ones each lifts off, at the time of the closed form and with its derivatives."""
    random = np.random.default_rng(1)
    for _ in range(12):
        base, body = random.uniform(0.3, 3, 2)
        scene, excess = SprungBody(base, body, 10 ** random.uniform(*decades)), 10 ** random.uniform(-2, 0.5)
        (time, (status, steps)), slope = lift_off_and_slope(scene, excess)
        assert status in PASSED and sum(steps) < 500
        expected, exact_slope = exact_lift_off_and_slope(scene, excess)
        # The tolerances are sizes, and the spring gives way by so much.
        relative = 1e-8 + 1e-8 * jnp.sqrt(scene.stiffness / 1e3) / jnp.sqrt(excess)
        assert_close(time / expected, 1.0, relative)
        assert_close(slope.stiffness / exact_slope.stiffness, 1.0, 10 * relative)


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("excess", [0.0, 1e-9, 1e-7, 1e-5, 1e-4, 1e-3, 1e-2, 0.1])
def test_a_machine_that_hardly_lifts_off_comes_down(excess, restitution):
    """Assert that whatever its speed is, the motion goes on, and that the machine stands on the floor again."""
    for frequency in np.random.default_rng(2).uniform(3, 100, 8):
        time, status, steps, final = hop(Unbalance(1 + excess, frequency, restitution))
        assert status in PASSED and sum(steps) < 700
        assert abs(final[0]) < 1e-10 / frequency**2 + 2 * excess**2 / frequency**2
        if excess > 1e-4:
            assert_close(time, landing(1 + excess, frequency), 1e-5)


@pytest.mark.slow
def test_a_base_lifts_off_in_single_precision():
    """Assert that it does of springs that give way by more than rounding makes of their length."""
    random, single = np.random.default_rng(3), lambda x: jnp.asarray(x, jnp.float32)
    for _ in range(20):
        base, body = random.uniform(0.3, 3, 2)
        scene = SprungBody(single(base), single(body), single(10 ** random.uniform(4, 5)))
        excess = single(10 ** random.uniform(-1, 0.5))
        time, (status, steps) = lift_off_once(scene, excess, single(1e-5), single(1e-6))
        assert status in PASSED and sum(steps) < 1000
        # The spring gives way by 1e-4 of its length at the least, of which rounding is 1e-3.
        assert_close(time / exact_lift_off(scene, excess), 1.0, 1e-3)
