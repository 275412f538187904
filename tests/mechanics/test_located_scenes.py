"""Scenes whose comparisons are events: against closed forms and differences."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens
from hybridsens.mechanics.mode import EventKind

TOLERANCES = {"rtol": 1e-10, "atol": 1e-10}
pytestmark = pytest.mark.filterwarnings("error::hybridsens.DiscontinuityWarning")


class Bumper(hybridsens.AbstractScene):
    """A mass with dry friction that meets a soft bumper at 0.5 and a hard wall at 1."""

    located_discontinuities = True
    friction: jax.Array
    stiffness: jax.Array
    restitution_coefficient: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.friction * jnp.sign(v[0]) * (1 + q**2) - self.stiffness * jnp.maximum(q - 0.5, 0)

    def gap(self, t, q):
        return 1 - q

    def restitution(self):
        return self.restitution_coefficient[None]


def bumped(values, **options):
    """Final position, and a running cost that jumps at a time and has a kink in v."""
    late = lambda scene, t, q, v: jnp.abs(v[0]) * jnp.where(t > 0.21, 1.0, 0.0)
    motion = hybridsens.simulate(
        Bumper(*values), hybridsens.State([0.0], [5.0]), t1=0.5, running_cost=late, **(TOLERANCES | options)
    )
    return motion, jnp.stack([motion.final.q[0], motion.cost])


AT = jnp.array([0.7, 20.0, 0.8])


@pytest.mark.slow
def test_an_impact_that_turns_a_comparison_is_followed_by_it_at_once():
    """Its bumper counts as switch 2, the direction of sliding as switches 0 and 1, and the clock of the cost as 3."""
    events = bumped(AT)[0].events
    kind, who = np.asarray(events.kind[:6]), np.asarray(events.contact[:6])
    assert kind.tolist() == [3, 0, 3, 3, 3, 3] and EventKind.SWITCH == 3 and int(events.count) == 6
    assert sorted(who[kind == 3].tolist()) == [0, 1, 2, 2, 3] and events.mode is None
    assert float(events.time[1]) == float(events.time[2]) == float(events.time[3])


@pytest.mark.slow
@pytest.mark.parametrize("method", [hybridsens.Replay(), hybridsens.ForwardSensitivities()], ids=["reverse", "forward"])
def test_gradients_through_friction_bumper_and_wall_are_those_of_differences(method):
    differentiate = jax.jacrev if isinstance(method, hybridsens.Replay) else jax.jacfwd
    found = jax.jit(differentiate(lambda values: bumped(values, adjoint=method)[1]))(AT)
    ways = 1e-5 * AT[:, None] * jnp.eye(3)
    each = jax.jit(jax.vmap(lambda values: bumped(values)[1]))(jnp.concatenate([AT + ways, AT - ways]))
    np.testing.assert_allclose(found, (each[:3] - each[3:]).T / (2e-5 * AT), atol=2e-8, rtol=1e-6)


class Sliding(hybridsens.AbstractScene):
    """A mass that a load pulls against dry friction."""

    located_discontinuities = True
    load: jax.Array
    friction: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return self.load - self.friction * jnp.sign(v)

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)


@jax.jit
def slid(load, friction, v0):
    """Place at t = 1, its derivatives, and the motion."""

    def place(load, friction, v0):
        motion = hybridsens.simulate(Sliding(load, friction), hybridsens.State([0.0], v0[None]), t1=1.0, throw=False)
        return motion.final.q[0], motion

    (_, motion), slopes = jax.value_and_grad(place, argnums=(0, 1, 2), has_aux=True)(load, friction, v0)
    return motion, slopes


def test_a_mass_that_dry_friction_stops_stays_where_no_load_pulls_it():
    """It goes v0^2 / (2 mu). What holds it under a load nothing says: a status does, at v0 / (mu - load)."""
    motion, (_, by_friction, by_v0) = slid(*map(jnp.array, (0.0, 0.7, 0.35)))
    assert motion.status == hybridsens.Status.successful and float(motion.events.time[0]) == pytest.approx(0.5)
    assert float(motion.final.q[0]) == pytest.approx(0.35**2 / 1.4) and abs(float(motion.final.v[0])) < 1e-15
    assert [float(by_friction), float(by_v0)] == pytest.approx([-((0.35 / 0.7) ** 2) / 2, 0.35 / 0.7])
    motion, _ = slid(*map(jnp.array, (0.3, 0.7, 0.35)))
    assert motion.status == hybridsens.Status.event_repeats and float(motion.end_time) == pytest.approx(0.35 / 0.4)


@pytest.mark.parametrize("load", [0.9, -0.9])
def test_a_load_that_friction_cannot_hold_sets_a_mass_in_motion(load):
    """q = (|load| - mu) / 2, in the direction of the load."""
    motion, (by_load, by_friction, _) = slid(*map(jnp.array, (load, 0.7, 0.0)))
    assert motion.status == hybridsens.Status.successful
    assert float(motion.final.q[0]) == pytest.approx(0.1 * np.sign(load))
    assert [float(by_load), float(by_friction)] == pytest.approx([0.5, -0.5 * np.sign(load)])


class Valley(hybridsens.AbstractScene):
    """A ball above two slopes that meet at x = 0, written as the least of two gaps."""

    located_discontinuities = True
    slope: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -9.81])

    def gap(self, t, q):
        return (q[1] - self.slope * jnp.abs(q[0]))[None]

    def restitution(self):
        return jnp.full(1, 0.7)


class TwoSlopes(Valley):
    """The same by a gap for each slope."""

    located_discontinuities = False

    def gap(self, t, q):
        return q[1] - self.slope * jnp.array([q[0], -q[0]])

    def restitution(self):
        return jnp.full(2, 0.7)


@pytest.mark.slow
def test_a_gap_with_a_corner_is_that_of_one_gap_for_each_side():
    """The ball bounces from one slope to the other: place and gradient by the slope."""

    def final(scene):
        state = hybridsens.State([0.3, 0.5], [0.0, 0.0])
        return hybridsens.simulate(scene, state, t1=0.85, **TOLERANCES).final.q[0]

    (one, by_one), (two, by_two) = (eqx.filter_value_and_grad(final)(kind(0.3)) for kind in (Valley, TwoSlopes))
    assert float(two) < -0.05
    np.testing.assert_allclose([one, by_one.slope], [two, by_two.slope], rtol=1e-8)


class Motor(hybridsens.AbstractSwitchedScene):
    """A motor that turns round at a place, against a drag with a kink, and holds no power before a time."""

    located_discontinuities = True
    power: jax.Array
    place: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return mode * self.power * jnp.where(t > 0.3, 1.0, 0.5) - jnp.maximum(v - 0.4, 0)

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)

    def switches(self, t, q, v, mode):
        return mode * (self.place - q)

    def switch(self, event, t, q, v, mode):
        return v, -mode


@pytest.mark.slow
def test_a_scene_keeps_its_own_switches_and_mode():
    def final(values):
        motion = hybridsens.simulate(Motor(*values), hybridsens.State([0.0], [0.0]), 1, t1=2.0, **TOLERANCES)
        return motion.final.q[0], motion

    at = jnp.array([1.3, 0.4])
    found, motion = jax.jacrev(final, has_aux=True)(at)
    own = np.asarray(motion.events.contact)[: int(motion.events.count)] == 0
    assert motion.events.mode.shape == motion.events.kind.shape and int(motion.scene_mode) == -1 and own.sum() == 1
    differences = [(final(at + way)[0] - final(at - way)[0]) / 2e-5 for way in 1e-5 * jnp.eye(2)]
    np.testing.assert_allclose(found, differences, atol=1e-8)
    assert float(jnp.abs(found).min()) > 0.1
