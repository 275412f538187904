"""What a held contact meets inside of a step where its place or its direction changes, and not the load."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics.held import load_varies, supports_move


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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_table_that_bumps_for_a_moment_throws_what_rests_on_it():
    throw = lambda **given: hs.simulate(Bumped(0.03), hs.State([0.0], [0.0]), t1=3.6, **given).events
    found, fine = throw(), throw(max_step=0.01)
    assert found.count == fine.count > 0
    np.testing.assert_allclose(found.time[: found.count], fine.time[: fine.count], atol=1e-6)


class Plank(hs.AbstractScene):
    """A plank of weight 1 on two rollers half a metre to both sides, which move together, aside by p(t) and back."""

    aside: jax.Array

    def mass_matrix(self, q):
        return jnp.diag(jnp.array([1.0, 0.2]))

    def force(self, t, q, v):
        return jnp.array([-1.0, 0.0])

    def gap(self, t, q):
        p = self.aside * jnp.exp(-(((t - 10) / 0.5) ** 2))
        return jnp.stack([q[0] + q[1] * (p - 0.5), q[0] + q[1] * (p + 0.5)])

    def restitution(self):
        return jnp.zeros(2)


@pytest.mark.slow
@pytest.mark.parametrize("aside", [0.4, 0.8])
def test_supports_that_move_aside_let_a_plank_go(aside):
    """By the balance of moments the multipliers are 1/2 + p and 1/2 - p, and the load is the same all the time."""
    rest = hs.State(jnp.zeros(2), jnp.zeros(2))
    motion = hs.simulate(Plank(jnp.array(aside)), rest, t1=20.0)
    if aside < 0.5:
        assert motion.events.count == 0
    else:
        released = 10 - 0.5 * np.sqrt(np.log(aside / 0.5))
        assert motion.events.kind[0] == hs.EventKind.RELEASE
        assert abs(motion.events.time[0] - released) < 1e-8


def test_only_supports_that_turn_with_time_are_looked_at():
    """A hill stands still, and a table that bumps keeps its direction: they cost nothing here."""
    t, still = jnp.array(9.0), jnp.zeros(2)
    assert supports_move(Plank(jnp.array(0.8)), t, still)
    assert not supports_move(Hilly(jnp.array(1.0)), t, still)
    assert not supports_move(Bumped(0.03), t, jnp.zeros(1))
    assert not load_varies(Hilly(jnp.array(1.0)), t, still, still)


class RaisedArm(hs.AbstractScene):
    """A ball of radius 0.02 on an arm of length 0.16 that turns up about its left end: q'' = -2 in height."""

    at: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -2.0])

    def gap(self, t, q):
        angle = -0.5 + 0.6 * (1 + jnp.tanh((t - self.at) / 0.03))
        tip = 0.16 * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        return hs.planar.to_segment(q, jnp.zeros(2), tip, 0.0235)[None]

    def restitution(self):
        return jnp.array([0.32])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hybridsens.DiscontinuityWarning")
def test_a_body_slides_off_the_rounded_end_of_a_moving_segment():
    """Bounds of its load are wide on any step there: steps were cut short again and again, and none got past."""
    start = hs.State([0.03, 0.08], [0.0, 0.0])
    motion = hs.simulate(RaisedArm(jnp.array(0.6)), start, t1=0.7, max_events=64, max_steps=1024, throw=False)
    assert motion.status == hs.Status.successful, hs.Status[motion.status]
    kinds = np.asarray(motion.events.kind)[: int(motion.events.count)]
    assert kinds[-1] == hs.EventKind.RELEASE
