"""Walls that move, close and squeeze, bodies of odd masses, starts and ends in the middle of an event: closed forms."""

from fractions import Fraction

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

FAR = ([0.0, 0.0], 1.0)
"""A contact that is never reached: normal and offset."""


class MovingWalls(hs.AbstractScene):
    """diag(mass) q'' = load + ramp t, gaps normals q + offsets + speeds t + pushes t^2."""

    mass: jax.Array
    load: jax.Array
    ramp: jax.Array
    normals: jax.Array
    offsets: jax.Array
    speeds: jax.Array
    pushes: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(self.mass)

    def force(self, t, q, v):
        return self.load + self.ramp * t

    def gap(self, t, q):
        return self.normals @ q + self.offsets + self.speeds * t + self.pushes * t**2

    def restitution(self):
        return self.e


@eqx.filter_jit
def _move(scene, q, v, t1):
    return hs.simulate(scene, hs.State(q, v), t1=t1, max_events=128, throw=False)


def move(q, v, t1, *contacts, load=(0, 0), ramp=(0, 0), mass=(1, 1), speeds=(0, 0), pushes=(0, 0), e=(1, 1)):
    """Two coordinates and up to two contacts, each a normal and an offset."""
    normals, offsets = zip(*contacts, *[FAR] * (2 - len(contacts)), strict=True)
    parts = mass, load, ramp, normals, offsets, speeds, pushes, e
    scene = MovingWalls(*(jnp.array(part, float) for part in parts))
    return _move(scene, *(jnp.array(part, float) for part in (q, v, t1)))


LEFT, RIGHT, FLOOR = ([1, 0], 0), ([-1, 0], 1), ([0, 1], 0)


@pytest.mark.parametrize("later", [-1e-9, -1e-12, 0.0, 1e-12, 1e-9])
def test_a_contact_closes_while_another_opens(later):
    """A body on the floor is lifted from t = 1 on; at that instant, or around it, another one falls on it.

    The one below is stopped by the floor, so it moves by its lift alone, and the other one rebounds."""
    on_top = ([-1, 1], 0)
    motion = move([0, 1 + later], [0, -1], 2.0, LEFT, on_top, load=[-1, 0], ramp=[1, 0], e=[0.5, 0.5])
    assert motion.status == hs.Status.successful and motion.events.count == 2
    assert_close(motion.final.q, np.array([1 / 6, 0.5]), 1e-8)
    assert_close(motion.final.v, np.array([0.5, 0.5]), 1e-8)


def fermi(speed, T):
    """Exact states of a body from 1/2 at speed 1 between a wall at `speed` t and one at 1, all rational."""
    t, q, v, impacts = Fraction(0), Fraction(1, 2), Fraction(1), 0
    while True:
        wait = (1 - q) / v if v > 0 else (q - speed * t) / (speed - v)
        if t + wait >= T:
            return float(q + v * (T - t)), float(v), impacts
        t, q, v, impacts = t + wait, q + v * wait, (-v if v > 0 else 2 * speed - v), impacts + 1


def test_a_wall_that_drives_a_body_pumps_the_energy_that_it_must():
    """Fermi acceleration: each impact on the driven wall adds twice its speed, 43 times; the truth is in fractions."""
    q, v, impacts = fermi(Fraction(1, 10), Fraction(899, 100))
    motion = move([0.5, 0], [1, 0], 8.99, LEFT, RIGHT, speeds=[-0.1, 0])
    assert motion.status == hs.Status.successful and motion.events.count == impacts == 85
    assert_close(motion.final.q[0], q, 1e-11)
    assert_close(motion.final.v[0], v, 1e-11)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_walls_that_close_on_a_body_end_in_a_status(e):
    """No motion exists beyond the instant at which they meet."""
    motion = move([0.5, 0], [0.3, 0], 1.0, LEFT, RIGHT, speeds=[-1, -1], e=[e, e])
    assert motion.status == hs.Status.max_events_reached
    assert 0 <= 0.5 - motion.events.time[motion.events.count - 1] < 0.01


@pytest.mark.parametrize("push, expected", [(0.1, 0.4), (-0.1, 0.0)])
def test_a_wall_that_sets_out_under_a_body_at_rest_takes_it_along_or_leaves(push, expected):
    """Gap and rate are 0 at the start; its acceleration alone tells whether the contact holds: q = push t^2 or 0."""
    motion = move([0, 0], [0, 0], 2.0, LEFT, pushes=[-push, 0])
    assert motion.status == hs.Status.successful and bool(motion.mode[0]) == (push > 0)
    assert_close(motion.final.q[0], expected, 1e-12, scale=1.0)


@pytest.mark.parametrize("mass", [1e-300, 1e-30, 1e30, 1e300])
def test_mass_has_no_scale(mass):
    """A ball of any mass falls, bounces twice and is where every ball is."""
    motion = move([1, 0], [0, 0], 1.0, LEFT, mass=[mass, 1], load=[-10 * mass, 0], e=[0.5, 0.5])
    flight = 1 - 2 * np.sqrt(0.2)
    assert motion.status == hs.Status.successful and motion.events.count == 2
    assert_close(motion.final.q[0], 0.25 * np.sqrt(20) * flight - 5 * flight**2, 1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_a_contact_written_twice_in_two_units_is_one_contact(scale):
    """The same gap in other units changes nothing: the ball comes to rest on both."""
    motion = move([1, 0], [0, 0], 3.0, LEFT, ([scale, 0], 0), load=[-10, 0], e=[0.5, 0.5])
    assert motion.status == hs.Status.successful and bool(jnp.any(motion.mode))
    assert_close(motion.final.q[0], 0.0, 1e-12, scale=1.0)


def test_a_start_in_a_corner_with_a_velocity_into_it_rebounds_by_the_law():
    """Into both walls of a square corner; into one wall of a wedge while leaving the other: v+ = v - (1 + e) rate n."""
    square = move([0, 0], [-1, -2], 1.0, LEFT, FLOOR)
    assert_close(square.final.v, np.array([1.0, 2.0]), 1e-15)
    wedge = move([0, 0], [1, -3], 1.0, LEFT, ([1, 0.5], 0), e=[0.5, 0.5])
    assert_close(wedge.final.v, np.array([1.6, -2.7]), 1e-15)


def test_a_start_between_walls_without_room_ends_at_rest_or_in_a_status():
    """With e < 1 the body rests after a cascade in no time; an elastic one never does."""
    inelastic = move([0, 0], [-1, 0], 1.0, LEFT, ([-1, 0], 0), e=[0.5, 0.5])
    assert inelastic.status == hs.Status.successful
    assert_close(inelastic.final.q[0], 0.0, 1e-4, scale=1.0)
    assert move([0, 0], [-1, 0], 1.0, LEFT, ([-1, 0], 0)).status == hs.Status.max_events_reached


def test_a_start_below_one_of_two_walls_is_told():
    """The other gap is open."""
    assert move([-1e-6, 0.5], [0, 0], 1.0, LEFT, FLOOR).status == hs.Status.penetration


class Polar(hs.AbstractScene):
    """A free particle in polar coordinates (r, angle): the mass matrix diag(1, r^2) is singular at r = 0."""

    def mass_matrix(self, q):
        return jnp.diag(jnp.stack([jnp.ones_like(q[0]), q[0] ** 2]))

    def force(self, t, q, v):
        return jnp.stack([q[0] * v[1] ** 2, -2 * q[0] * v[0] * v[1]])

    def gap(self, t, q):
        return q[:1] + 10

    def restitution(self):
        return jnp.ones(1)


@pytest.mark.parametrize("miss", [1e-1, 1e-3, 1e-6])
def test_a_mass_matrix_that_is_almost_singular_on_the_way(miss):
    """A straight line past the origin at a distance `miss`: the angle turns by nearly pi."""
    r, angle = np.hypot(1, miss), np.arctan2(miss, -1)
    state = hs.State(jnp.array([r, angle]), jnp.array([-1 / r, -miss / r**2]))
    motion = eqx.filter_jit(hs.simulate)(Polar(), state, t1=jnp.array(2.0), throw=False)
    assert motion.status == hs.Status.successful
    assert_close(motion.final.q, np.array([r, np.arctan2(miss, 1)]), 1e-7)


@pytest.mark.slow
def test_data_times_may_repeat_and_stand_on_an_impact():
    """Each is the state there, after the event or within rounding before it, and its derivative is the velocity."""
    fall = np.sqrt(0.2)
    ts = jnp.array([0.0, 0.0, fall, fall, 0.7, 0.7, 1.0, 1.0])
    ball = hs.scenes.BouncingBall(weight=10.0, restitution_coefficient=0.5)

    def sampled(ts):
        motion = hs.simulate(ball, ball.initial_state(), t1=1.0, ts=ts)
        return motion.q[:, 0], motion.v[:, 0]

    slope, v = jax.jit(jax.jacrev(sampled, has_aux=True))(ts)
    q, _ = sampled(ts)
    s = 0.7 - fall
    assert_close(q[::2], q[1::2], 0.0)
    assert_close(q[:5:2], np.array([1.0, 0.0, 0.5 * np.sqrt(20) * s - 5 * s**2]), 1e-13)
    assert_close(slope, np.diag(v), 1e-12)


class Shaker(hs.AbstractScene):
    """A free body before a wall that shakes at 10 kHz, gap q - A sin(w t)."""

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.zeros(1)

    def gap(self, t, q):
        return q - 1e-5 * jnp.sin(2e4 * jnp.pi * t)

    def restitution(self):
        return jnp.ones(1)


def test_a_slow_body_meets_a_wall_that_shakes_fast_at_its_first_touch():
    """The gap dips ever deeper for twenty periods; with steps shorter than a period the first touch is met."""
    motion = hs.simulate(Shaker(), hs.State(jnp.array([1e-4]), jnp.array([-1e-2])), t1=0.02, max_step=5e-5)
    t, wall = np.linspace(0, 0.02, 2_000_001), lambda t: 1e-5 * np.sin(2e4 * np.pi * t)
    touch = t[np.argmax(1e-4 - 1e-2 * t < wall(t))]
    assert motion.events.count == 1
    assert_close(motion.events.time[0], touch, 2e-8, scale=1.0)
    assert_close(motion.final.v[0], 1e-2 + 2 * 0.2 * np.pi * np.cos(2e4 * np.pi * float(motion.events.time[0])), 1e-9)
