"""Impacts at one instant whose order decides the outcome are marked in the ledger of events, and no others are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.problems import linear_contacts as linear

ORTHOGONAL = [([1.0, 0.0, 0.0], 0.0), ([0.0, 1.0, 0.0], 0.0)]
ACUTE = [([1.0, 0.0, 0.0], 0.0), ([-0.5, np.sqrt(0.75), 0.0], 0.0)]
NO_FORCE = dict(force=(0.0, 0.0, 0.0))


def corner(contacts, q, v=(-1.0, -1.0, 0.0), e=0.8, t1=1.5):
    """A flight towards two walls at an angle."""
    return linear.solve(linear.scene(contacts, [e] * len(contacts), **NO_FORCE), q, v, t1).trajectory


def marks(trajectory):
    return trajectory.events.order_matters[: int(trajectory.events.count)].tolist()


@pytest.mark.slow
def test_a_corner_hit_exactly_is_marked():
    """Both walls close at t = 1, and the impulse of one changes the rate at the other."""
    normal = np.array(ACUTE[1][0])[:2]
    v = np.array([-1.0, -1.0])
    assert normal @ v < 0
    trajectory = corner(ACUTE, [1.0, 1.0, 0.0])
    assert marks(trajectory)[0]
    text = str(trajectory)
    assert text.count(" *\n") == 1 and "one-sided at best" in text


@pytest.mark.slow
def test_a_corner_hit_beside_its_edge_is_not_marked():
    """One wall after the other, however soon."""
    trajectory = corner(ACUTE, [1.0, 1.001, 0.0])
    assert trajectory.events.count >= 1 and not any(marks(trajectory))
    assert "one-sided" not in str(trajectory)


def test_orthogonal_walls_are_not_marked():
    """Their impacts commute."""
    assert marks(corner(ORTHOGONAL, [1.0, 1.0, 0.0])) == [False, False]


class Valley(hs.AbstractScene):
    """A ball between two walls, each at an angle to the vertical."""

    angle: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -9.81])

    def gap(self, t, q):
        along, up = jnp.sin(self.angle) * q[0], jnp.cos(self.angle) * q[1]
        return jnp.stack([up + along, up - along])

    def restitution(self):
        return jnp.full(2, 0.6)


class BouncingValley(Valley):
    sustained_contact = False


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Valley, BouncingValley])
def test_walls_that_are_orthogonal_at_this_angle_alone_are_marked(kind):
    """In a V of 90 degrees the walls act on each other at any other angle: the derivative by it does not exist."""
    angle = jnp.array(np.pi / 4)
    drop = lambda x, angle: hs.simulate(kind(angle), hs.State(jnp.stack([x, 1.0]), jnp.zeros(2)), t1=0.7)
    assert marks(drop(0.0, angle)) == [True, False]
    assert marks(drop(0.01, angle)) == [False, False]  # one after the other
    slope = jax.jit(jax.grad(lambda angle, x: drop(x, angle).final.q[0]))
    assert slope(angle, 1e-3) * slope(angle, -1e-3) < -1  # one derivative on each side


def test_a_row_of_touching_balls_is_marked():
    """A gap between the two that are struck, however small, would make another outcome."""
    row = [([-1.0, 1.0, 0.0], 0.0), ([0.0, -1.0, 1.0], 0.0)]
    trajectory = corner(row, [1.0, 2.0, 2.0], [1.0, 0.0, 0.0], 1.0)
    assert marks(trajectory) == [True]


def test_a_wall_struck_while_a_leaning_floor_is_held_is_not_marked():
    """The floor is held by a force, before and after any small change."""
    slant = np.pi / 6
    walls = [([0.0, 1.0, 0.0], 0.0), ([-np.cos(slant), -np.sin(slant), 0.0], np.cos(slant))]
    motion = linear.solve(linear.scene(walls, [0.0, 0.8]), [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 2.0)
    assert marks(motion.trajectory) == [False]


class Corner(hs.AbstractScene):
    """Two walls at 60 degrees; no contact stays closed."""

    e: jax.Array
    sustained_contact = False

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.zeros(2)

    def gap(self, t, q):
        return jnp.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)]]) @ q

    def restitution(self):
        return jnp.stack([self.e, self.e])


@pytest.mark.parametrize("way", ["alone", pytest.param("batch", marks=pytest.mark.slow)])
def test_marks_go_through_gradients_and_batches(way):
    """As other discrete data of the ledger: a gradient passes them by, and each lane has its own."""

    def final(e, y):
        motion = hs.simulate(Corner(e), hs.State(jnp.stack([1.0, y]), jnp.array([-1.0, -1.0])), t1=1.5, throw=False)
        return motion.final.q[0], motion.events.order_matters

    gradient = jax.grad(final, has_aux=True)
    if way == "alone":
        slope, found = gradient(jnp.array(0.8), jnp.array(1.0))
        assert found.dtype == bool and bool(found[0]) and bool(jnp.isfinite(slope))
        return
    slopes, found = jax.jit(jax.vmap(gradient))(jnp.full(2, 0.8), jnp.array([1.0, 1.001]))
    assert found[:, 0].tolist() == [True, False] and bool(jnp.all(jnp.isfinite(slopes)))


class Floors(hs.AbstractScene):
    """A body above a floor, at distances that are said in other units: gap_i = scale_i (q - floor_i(t))."""

    scale: jax.Array
    e: jax.Array
    lift: jax.Array
    """Accelerations of the floors, all of them at 0 and at rest at t = 0."""

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.array([-9.81])

    def gap(self, t, q):
        return self.scale * (q[0] - self.lift * t**2 / 2)

    def restitution(self):
        return self.e


class ElasticFloors(Floors):
    """The same, where no contact stays closed."""

    sustained_contact = False


SCALES = [[2.0, 1.0], [3.0, 1.0, 2.0], [2.0, *[3.0] * 8, 1.0]]


@pytest.mark.parametrize("scale", [pytest.param(s, marks=[pytest.mark.slow] * (len(s) != 3)) for s in SCALES], ids=len)
def test_of_floors_at_one_place_the_most_elastic_one_acts(scale):
    """The law holds at each of them, so that the body leaves with the largest of the restitutions (T3)."""
    e = np.linspace(0.1, 0.9, len(scale))
    scene = ElasticFloors(jnp.array(scale), jnp.array(e), jnp.zeros(len(scale)))
    end = lambda scene: hs.simulate(scene, hs.State([1.0], [0.0]), t1=0.8).final.q[0]
    fall = np.sqrt(2 / 9.81)
    flight = 0.8 - fall
    value, gradient = jax.jit(jax.value_and_grad(end))(scene)
    assert abs(value - (0.9 * 9.81 * fall * flight - 9.81 * flight**2 / 2)) < 1e-9
    assert abs(gradient.e[-1] - 9.81 * fall * flight) < 1e-8 and not np.any(gradient.e[:-1])


@pytest.mark.parametrize("scale", [[2.0, 1.0], pytest.param([3.0, 1.0, 2.0], marks=pytest.mark.slow)], ids=len)
def test_of_floors_that_rise_the_fastest_one_carries(scale):
    """A body that rests on all of them at the start moves with the one that accelerates most (T2)."""
    lift = np.linspace(0.5, 2.0, len(scale))
    scene = Floors(jnp.array(scale), jnp.zeros(len(scale)), jnp.array(lift))
    motion = jax.jit(lambda scene: hs.simulate(scene, hs.State([0.0], [0.0]), t1=1.0))(scene)
    assert abs(motion.final.q[0] - 1.0) < 1e-9
    assert np.flatnonzero(motion.mode).tolist() == [len(scale) - 1]


class Stack(hs.AbstractScene):
    """Points on a line above a floor, the lowest first; `rows` are those of their gaps."""

    mass: jax.Array
    e: jax.Array
    rows: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(self.mass)

    def force(self, t, q, v):
        return jnp.zeros(3)

    def gap(self, t, q):
        return self.rows @ q

    def restitution(self):
        return self.e


@pytest.mark.parametrize("mass", [[1.0, 1.0, 1.0], [4.0, 2.0, 1.0]])
@pytest.mark.parametrize("e", [0.5, 1.0])
@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 0, 2]])
def test_contacts_that_others_link_meet_in_one_impact(mass, e, order):
    """Assert Newton's law of all three at once, which here sends every point back, whichever gap comes first: the outer
    two do not act on each other, but on the one between."""
    rows, v = jnp.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]]), jnp.array([-1.0, -2.0, -4.0])
    stack = Stack(jnp.array(mass), jnp.full(3, e), rows[jnp.array(order)])
    motion = hs.simulate(stack, hs.State(-v / 2, v), t1=0.75, max_events=8, max_steps=64)
    np.testing.assert_allclose(motion.final.v, -e * v, rtol=1e-12)
    assert marks(motion) == [True]
