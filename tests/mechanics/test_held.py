"""What a held contact meets inside of a step: while all is held, or slides freely, nothing else limits the steps."""

import equinox as eqx
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


@pytest.mark.slow
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


def test_only_a_load_that_bends_is_looked_at():
    """In time; in place where a body that is held can move."""
    parts = jnp.array(1.0), jnp.array(0.5), jnp.array(3.0)
    at = jnp.array(0.3), jnp.zeros(1), jnp.zeros(1)
    assert load_varies(Loaded(*parts), *at)
    assert not any(load_varies(kind(*parts), *at) for kind in (Constant, Growing, OfTheState))
    plane = jnp.array(0.3), jnp.zeros(2), jnp.zeros(2)
    assert load_varies(Magnet(jnp.array(LIFT)), *plane)


LIFT = 3.0


class Magnet(hs.AbstractScene):
    """A block that slides at speed 1 on a floor, under a magnet which lifts it near x = 10."""

    lift: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.stack([0 * t, self.lift * jnp.exp(-((q[0] - 10.0) ** 2)) - 1.0])

    def gap(self, t, q):
        return q[1:]

    def restitution(self):
        return jnp.array([0.5])


@pytest.mark.slow
def test_a_load_that_depends_on_place_is_seen():
    """Released where lift exp(-(x - 10)^2) = 1; in a step that ends behind the magnet its load is as before it."""

    def release(lift):
        motion = hs.simulate(Magnet(lift), hs.State([0.0, 0.0], [1.0, 0.0]), t1=12.0, max_events=8)
        return motion.events.time[0]

    time, slope = jax.value_and_grad(release)(jnp.array(LIFT))
    root = np.sqrt(np.log(LIFT))
    np.testing.assert_allclose([time, slope], [10 - root, -1 / (2 * LIFT * root)], rtol=1e-8)


class OfEnergies(hs.LagrangianScene):
    """The same block: its magnet is a potential."""

    lift: jax.Array

    def kinetic_energy(self, q, v):
        return 0.5 * v @ v

    def potential_energy(self, q):
        return q[1] * (1 - self.lift * jnp.exp(-((q[0] - 10.0) ** 2)))

    def gap(self, t, q):
        return q[1:]

    def restitution(self):
        return jnp.array([0.5])


class BesideEnergies(OfEnergies):
    """The same block: its magnet is added to what follows from the energies."""

    def potential_energy(self, q):
        return q[1]

    def force(self, t, q, v):
        pull = self.lift * jnp.exp(-((q[0] - 10.0) ** 2))
        return super().force(t, q, v) + jnp.stack([0 * t, pull])


class OverACrest(OfEnergies):
    """A car that is thrown off by the curvature of its track, in coordinates of the track: at a constant velocity."""

    def kinetic_energy(self, q, v):
        return 0.5 * v @ v + q[1] * self.lift * jnp.exp(-((q[0] - 10.0) ** 2)) * v[0] ** 2

    def potential_energy(self, q):
        return q[1]


@pytest.mark.slow
@pytest.mark.parametrize("magnet", [OfEnergies, BesideEnergies, OverACrest])
def test_a_load_is_seen_that_follows_from_energies_or_is_added_to_them(magnet):
    """Forces of inertia are left out of the search only where no gap is affine in a coordinate."""
    motion = hs.simulate(magnet(jnp.array(LIFT)), hs.State([0.0, 0.0], [1.0, 0.0]), t1=12.0, max_events=8)
    assert motion.events.kind[0] == hs.EventKind.RELEASE
    assert abs(motion.events.time[0] - (10 - np.sqrt(np.log(LIFT)))) < 1e-8


class Pulsed(Loaded):
    """amplitude / weight pulses of the load at t = 1 + frequency / 60, a thousandth to a second long."""

    def load(self, t):
        width = 10 ** (-3 + 3 * (self.weight - 0.2) / 1.8)
        return self.amplitude / self.weight * 3 * jnp.exp(-(((t - 1 - self.frequency / 60) / width) ** 2)) - 1


@pytest.mark.slow
def test_pulses_of_any_length_are_found(loads):
    weight, amplitude, frequency = map(jnp.asarray, loads)

    def first(weight, amplitude, frequency):
        rest, settings = hs.State(jnp.zeros(1), jnp.zeros(1)), dict(t1=20.0, max_events=64, max_steps=8192)
        return hs.simulate(Pulsed(weight, amplitude, frequency), rest, throw=False, **settings).events.time[0]

    found, height = jax.jit(jax.vmap(first))(weight, amplitude, frequency), 3 * amplitude / weight
    expected = 1 + frequency / 60 - 10 ** (-3 + 3 * (weight - 0.2) / 1.8) * jnp.sqrt(jnp.log(height))
    np.testing.assert_allclose(found, expected, atol=1e-7)


class FromATable(Magnet):
    """It pulls by up to `lift` between 9.9 and 10.1 only."""

    known_discontinuities = True
    beyond: str | None = eqx.field(static=True, default=None)

    def force(self, t, q, v):
        places, pull = jnp.array([0.0, 9.9, 10.0, 10.1]), jnp.array([0.0, 0.0, 1.0, 0.0])
        return jnp.stack([0 * t, self.lift * jnp.interp(q[0], places, pull, left=self.beyond) - 1.0])


@pytest.mark.slow
def test_a_load_that_a_table_tells_is_seen():
    """At a slide of 1 m/s, where the table tells a third."""
    motion = hs.simulate(FromATable(jnp.array(LIFT)), hs.State([0.0, 0.0], [1.0, 0.0]), t1=12.0)
    assert motion.events.kind[0] == hs.EventKind.RELEASE and abs(motion.events.time[0] - 9.9 - 0.1 / 3) < 1e-8


def test_a_load_without_bounds_is_told_to_be_sampled():
    """A table that goes on beyond its ends, say."""
    with pytest.warns(UserWarning, match=r"Forces on held contacts \[1\] are read from a table"):
        hs.simulate(FromATable(jnp.array(LIFT), "extrapolate"), hs.State([0.0, 0.0], [1.0, 0.0]), t1=12.0)


class Approached(hs.AbstractScene):
    """A rests on a stop without a load; B, on a spring at its rest length, moves towards it, and away again."""

    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        spring = q[1] - q[0] - 1.0
        return jnp.stack([spring, -spring])

    def gap(self, t, q):
        return q[:1]

    def restitution(self):
        return self.e[None]


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_what_rests_without_a_load_is_held_when_one_grows(e):
    """B is at 1 - sin(t) / 2 until pi, then the spring pulls A off. It did not strike the stop before, whatever e."""
    motion = hs.simulate(Approached(jnp.array(e)), hs.State([0.0, 1.0], [0.0, -0.5]), t1=10.0)
    t, w = 10 - np.pi, np.sqrt(2)
    np.testing.assert_allclose(motion.final.q[0], t / 4 - np.sin(w * t) / (4 * w), rtol=1e-7)
