"""A load that lets a held contact go for less than a step: while all is held, nothing else limits the steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import hybridsens as hs
from hybridsens.mechanics.held import load_varies


class Loaded(hs.AbstractScene):
    """A mass on a floor, pressed on it by a load that may lift it."""

    weight: jax.Array
    amplitude: jax.Array
    frequency: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.stack([self.load(t)])

    def load(self, t):
        lift = jnp.sin(self.frequency * t) * jnp.sin(1.3 * self.frequency * t)
        return self.amplitude * lift - self.weight

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.array([0.5])


class Constant(Loaded):
    def load(self, t):
        return -self.weight


class Growing(Loaded):
    def load(self, t):
        return self.amplitude * t - self.weight


class OfTheState(Loaded):
    def force(self, t, q, v):
        return jnp.sin(q) - self.weight


T1, LOADS = 2.0, 120


def first_release(weight, amplitude, frequency) -> float:
    """When the multiplier, weight - amplitude sin(w t) sin(1.3 w t), first falls through zero; inf if never."""
    multiplier = lambda t: weight - amplitude * np.sin(frequency * t) * np.sin(1.3 * frequency * t)
    times = np.linspace(0, T1, 200_001)
    below = np.flatnonzero(multiplier(times) < 0)
    if below.size == 0:
        return np.inf
    return brentq(multiplier, times[below[0] - 1], times[below[0]], xtol=1e-15)


@pytest.fixture(scope="module")
def loads():
    random = np.random.default_rng(0)
    ranges = [(0.2, 2.0), (0.5, 1.5), (1.0, 60.0)]
    weight, part, frequency = (random.uniform(*each, LOADS) for each in ranges)
    return weight, weight * part, frequency


def test_every_release_is_found(loads):
    """Judged by the ends of the steps alone, one in twenty was missed, in silence."""

    def first(weight, amplitude, frequency):
        rest = hs.State(jnp.zeros(1), jnp.zeros(1))
        motion = hs.simulate(Loaded(weight, amplitude, frequency), rest, t1=T1, max_events=512, throw=False)
        return motion.events.time[0]

    found = jax.jit(jax.vmap(first))(*map(jnp.asarray, loads))
    right = np.array([first_release(*load) for load in zip(*loads, strict=True)])
    assert 20 < np.isfinite(right).sum() < LOADS - 20
    np.testing.assert_allclose(found, right, atol=1e-9)


def test_only_a_load_that_bends_in_time_is_looked_at():
    parts = jnp.array(1.0), jnp.array(0.5), jnp.array(3.0)
    at = jnp.array(0.3), jnp.zeros(1), jnp.zeros(1)
    assert load_varies(Loaded(*parts), *at)
    assert not any(load_varies(kind(*parts), *at) for kind in (Constant, Growing, OfTheState))


class Hilly(hs.AbstractScene):
    """A body that slides along a floor with a hill on it, far from where it begins."""

    width: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -9.81])

    def gap(self, t, q):
        return (q[1] - jnp.exp(-(((q[0] - 20.0) / self.width) ** 2)))[None]

    def restitution(self):
        return jnp.array([0.5])


@pytest.mark.parametrize("width", [1.0, 0.1])
def test_a_hill_that_a_held_contact_comes_to_is_seen(width):
    """It has not the energy to cross it. Where it slid on the flat no error limits the steps."""
    slide = lambda **given: hs.simulate(Hilly(jnp.array(width)), hs.State([0.0, 0.0], [3.0, 0.0]), t1=10.0, **given)
    found, fine = slide(), slide(max_step=0.01)
    np.testing.assert_allclose(found.final.v, [-3.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(found.final.q, fine.final.q, atol=1e-6)
    assert found.steps.accepted < 300


class Bumped(hs.AbstractScene):
    """A body that rests on a table, which is lifted for a moment."""

    width: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.array([-9.81])

    def gap(self, t, q):
        return q - 0.05 * jnp.exp(-(((t - 3.3) / self.width) ** 2))

    def restitution(self):
        return jnp.array([0.5])


def test_a_table_that_bumps_for_a_moment_throws_what_rests_on_it():
    throw = lambda **given: hs.simulate(Bumped(0.03), hs.State([0.0], [0.0]), t1=3.6, **given).events
    found, fine = throw(), throw(max_step=0.01)
    assert found.count == fine.count > 0
    np.testing.assert_allclose(found.time[: found.count], fine.time[: fine.count], atol=1e-6)
