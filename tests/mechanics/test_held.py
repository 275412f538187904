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
