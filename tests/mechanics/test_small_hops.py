"""Releases that rounding blurs, and hops that are hardly larger than it, as of a machine that just lifts off."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

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


@jax.jit
def lift_off(scene, excess):
    """Of the base, when the body is let go deeper by so much than it may be; the first event and the status."""
    rest = -scene.body * 9.81 / scene.stiffness
    q = jnp.stack([0 * rest, 1 + rest - scene.deflection() * (1 + excess)])
    t1 = 1.7 * 2 * jnp.pi * jnp.sqrt(scene.body / scene.stiffness)
    motion = hs.simulate(scene, hs.State(q, jnp.zeros(2)), t1=t1, max_events=64, throw=False)
    return motion.events.time[0], (motion.status.code, motion.steps)


def exact_lift_off(scene, excess):
    """The body swings as cos(w t) about its rest, and the base lifts off at -1 / (1 + excess)."""
    return jnp.arccos(-1 / (1 + excess)) * jnp.sqrt(scene.body / scene.stiffness)


@pytest.mark.parametrize("decades", [(2, 3), (4, 5), (6, 7), (8, 9)])
def test_a_base_lifts_off_under_a_stiff_spring(decades):
    """Assert that of random ones each lifts off, at the time of the closed form and with its derivatives."""
    random = np.random.default_rng(1)
    for _ in range(20):
        base, body = random.uniform(0.3, 3, 2)
        scene = SprungBody(base, body, 10 ** random.uniform(*decades))
        excess = jnp.asarray(10 ** random.uniform(-2, 0.5))
        (time, (status, steps)), slope = jax.value_and_grad(lift_off, has_aux=True)(scene, excess)
        assert status == hs.Status.successful.code and sum(steps) < 500
        expected, exact_slope = jax.value_and_grad(exact_lift_off)(scene, excess)
        # The spring's force, of size k, is rounded, and the body swings by k-th parts of its weight.
        blur = 1e-6 + 1e-15 * scene.stiffness / 9.81 / jnp.sqrt(excess)
        assert abs(time / expected - 1) < blur
        assert_close(slope.stiffness / exact_slope.stiffness, 1.0, 100 * blur)
