"""A load that goes from one redundant foot to another, and one that rests between two."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

WEIGHT = 20.0


class Table(hs.AbstractScene):
    """A table whose load moves from `start` at a constant velocity, or swings; q = height and two tilts. The feet stand
    at (x, y)."""

    x: jax.Array
    y: jax.Array
    start: jax.Array
    velocity: jax.Array
    frequency: jax.Array = 0.0
    restitution_coefficient: jax.Array = 0.3
    origin: jax.Array = 0.0
    """What the clock shows where the load is at `start`."""

    def mass_matrix(self, q):
        return jnp.diag(jnp.array([2.0, 0.3, 0.4]))

    def load(self, t):
        t = t - self.origin
        swings = self.frequency > 0
        way = jnp.where(swings, jnp.sin(self.frequency * t) / jnp.where(swings, self.frequency, 1), t)
        return self.start + self.velocity * way

    def force(self, t, q, v):
        return -WEIGHT * jnp.concatenate([jnp.ones(1), self.load(t)])

    def gap(self, t, q):
        return q[0] + self.x * q[1] + self.y * q[2]

    def restitution(self):
        return jnp.full(self.x.shape, self.restitution_coefficient)


FOUR = np.array([[0.5, -0.5, -0.5, 0.5], [0.4, 0.4, -0.4, -0.4]])
AT_REST = hs.State(jnp.zeros(3), jnp.zeros(3))


def table(start, velocity, feet=FOUR, frequency=0.0, origin=0.0):
    given = feet[0], feet[1], np.array(start), np.array(velocity), frequency, 0.3, origin
    return Table(*(jnp.asarray(one, float) for one in given))


@jax.jit
def stand(scene, t1):
    """From the instant at which the scene's clock starts until so much later."""
    return hs.simulate(scene, AT_REST, t0=scene.origin, t1=scene.origin + t1, max_events=32, throw=False)


def assert_stands(trajectory):
    """The truth while the load is between the feet: nothing moves, nothing strikes."""
    assert trajectory.status == hs.Status.successful
    np.testing.assert_allclose(trajectory.final.q, np.zeros(3), atol=1e-14)
    kinds = np.asarray(trajectory.events.kind)[: int(trajectory.events.count)]
    assert (kinds == hs.EventKind.RELEASE).all()


@pytest.mark.slow
@pytest.mark.parametrize("height", [-0.31, -0.1, 0.05, 0.2])
def test_a_load_that_crosses_a_diagonal_moves_nothing(height):
    """Feet are let go, if any, where the load comes to a diagonal, |x| / 0.5 = |y| / 0.4."""
    trajectory = stand(table((-0.45, height), (0.3, 0.0)), 3.0)
    assert_stands(trajectory)
    crossings = (np.array([-1, 1]) * abs(height) / 0.8 + 0.45) / 0.3
    for time in np.asarray(trajectory.events.time)[: int(trajectory.events.count)]:
        assert np.min(np.abs(crossings - time)) < 1e-11


@pytest.mark.slow
def test_loads_that_swing_between_the_feet_move_nothing():
    rng = np.random.default_rng(7)
    handed_over = 0
    for _ in range(40):
        frequency = rng.uniform(1, 10)
        start, velocity = rng.choice([0, 1]) * rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.3, 0.3, 2) * frequency
        trajectory = stand(table(start, velocity, frequency=frequency), 2.0)
        assert_stands(trajectory)
        handed_over += int(trajectory.events.count)
    assert handed_over > 20


@pytest.mark.parametrize("frequency", [1.0, 3.0])
def test_a_load_that_swings_along_a_diagonal_moves_nothing(frequency):
    trajectory = stand(table((0.0, 0.0), (0.4 * frequency, 0.32 * frequency), frequency=frequency), 3.0)
    assert_stands(trajectory)
    assert trajectory.events.count == 0 and trajectory.steps.accepted + trajectory.steps.rejected < 60


def test_a_load_that_touches_a_diagonal_and_turns_moves_nothing():
    """Its foot has no force for an instant, at which the force's rate is 0 too: what is let go then comes back."""
    trajectory = stand(table((0.0, 0.1), (0.125 * np.pi / 2, 0.0), frequency=np.pi / 2), 3.0)
    assert_stands(trajectory)
    assert np.abs(trajectory.events.time[: int(trajectory.events.count)] - 1).max(initial=0) < 1e-6


@pytest.mark.parametrize("angle", [0.0, 0.4])
@pytest.mark.parametrize("feet", [4, pytest.param(6, marks=pytest.mark.slow)])
def test_a_table_with_its_load_in_the_middle_stands_for_long(feet, angle):
    """Rounding alone does not tip it about the line through the two feet that carry the load."""
    at = 2 * np.pi * (np.arange(feet) + 0.5) / feet + angle
    trajectory = stand(table((0.0, 0.0), (0.0, 0.0), np.stack([np.cos(at), np.sin(at)])), 1000.0)
    assert_stands(trajectory)
    assert trajectory.events.count == 0 and trajectory.steps.accepted + trajectory.steps.rejected < 20


@jax.jit
def place_and_slopes(scene, t1):
    """q(t1) and its derivatives by the scene's numbers."""

    def place(scene):
        q = hs.simulate(scene, AT_REST, t1=t1, max_events=32).final.q
        return q, q

    slopes, q = jax.jacrev(place, has_aux=True)(scene)
    return q, slopes


@pytest.mark.slow
def test_no_load_in_the_middle_would_tip_the_table():
    """The feet on either side would take up whatever is added, so that the derivatives of the tilt are 0."""
    _, slopes = place_and_slopes(table((0.0, 0.0), (0.0, 0.0)), 2.0)
    assert_close(slopes.start, np.zeros((3, 2)), 1e-12, scale=1.0)


@pytest.mark.parametrize("off", [1e-16, 1e-14, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9])
def test_a_load_next_to_a_diagonal_moves_nothing(off):
    trajectory = stand(table((0.125 + off, -0.1), (0.0, 0.0)), 20.0)
    assert_stands(trajectory)
    assert trajectory.events.count == 0


def test_a_load_that_leaves_the_table_tips_it():
    """Beyond the edge x = 1/2 the table turns about that edge, z = -a / 2: (J + m / 4) a'' = -W (s t - 1/2), from the
    instant at which the load comes there."""
    speed, t1 = 0.4, 3.6
    q, slopes = place_and_slopes(table((-0.3, 0.2), (speed, 0.0)), t1)
    flight = t1 - 0.8 / speed
    inertia = 0.3 + 2.0 / 4
    assert_close(q[1], -WEIGHT * speed * flight**3 / (6 * inertia), 1e-9)
    by_speed = -WEIGHT * (flight**3 + 3 * speed * flight**2 * 0.8 / speed**2) / (6 * inertia)
    assert_close(slopes.velocity[1, 0], by_speed, 1e-8)


def test_a_load_that_leaves_soon_after_a_start_at_a_late_clock_tips_the_table():
    """The clock shows 1.7e9 s, in steps of 2.4e-7 s. What the forces will be a while later must not decide."""
    origin, lag = 1.7e9, 5e-4
    trajectory = stand(table((0.5 - 0.4 * lag, 0.2), (0.4, 0.0), origin=origin), 2 * lag)
    assert trajectory.status == hs.Status.successful
    assert trajectory.events.count == 1 and trajectory.events.kind[0] == hs.EventKind.RELEASE
    assert abs(trajectory.events.time[0] - origin - lag) < 1e-6
    assert_close(trajectory.final.q[1], -WEIGHT * 0.4 * lag**3 / (6 * 0.8), 1e-2)
