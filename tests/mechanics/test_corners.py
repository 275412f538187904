"""Gaps that jump, or have a corner while their contact is held: the motion ends there with a status of its own."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Slider(hs.AbstractScene):
    """A point mass under weight p[0]; p[1] is a coefficient of restitution."""

    p: jax.Array
    known_discontinuities = True

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.stack([0 * self.p[0], -self.p[0]])

    def restitution(self):
        return self.p[1:2]


class Roof(Slider):
    """A ledge and a slope written as one gap."""

    def gap(self, t, q):
        return jnp.maximum(q[1], (q[1] + q[0]) / jnp.sqrt(2.0))[None]


class Table(Slider):
    """The same by a table."""

    def gap(self, t, q):
        return (q[1] - jnp.interp(q[0], jnp.array([-10.0, 0.0, 10.0]), jnp.array([0.0, 0.0, -10.0])))[None]


class Valley(Slider):
    """Two slopes written as one gap."""

    def gap(self, t, q):
        return jnp.minimum((q[1] - 0.5 * q[0]) / jnp.sqrt(1.25), (q[1] + q[0]) / jnp.sqrt(2.0))[None]


class RoundedRoof(Slider):
    """A ledge and a slope with an edge of radius about 0.1."""

    def gap(self, t, q):
        return (0.1 * jnp.logaddexp(10 * q[1], 10 * (q[1] + q[0]) / jnp.sqrt(2.0)))[None]


class Step(hs.AbstractScene):
    """A floor that jumps up by 1 at t = 1."""

    weight: jax.Array
    known_discontinuities = True

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return q - jnp.where(t < 1, 0, 1)

    def restitution(self):
        return jnp.full(1, 0.8)


@eqx.filter_jit
def run(scene, q, v, t1, **settings):
    return hs.simulate(scene, hs.State(jnp.array(q, float), jnp.array(v, float)), t1=t1, throw=False, **settings)


def ends_at(motion, time):
    """The motion ended there with the status, far from having used up its steps."""
    assert motion.status == hs.Status.gap_not_smooth, hs.Status[motion.status]
    assert motion.steps.accepted + motion.steps.rejected < 300
    assert_close(np.asarray(motion.ts)[np.isfinite(motion.q[:, 0])][-1], time, 0.03)


TS = jnp.linspace(0, 0.8, 81)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-8, 1e-5, 1e-12])
@pytest.mark.parametrize(
    "scene, settings",
    [
        pytest.param(Roof, {}, id="maximum"),
        pytest.param(Table, dict(max_step=0.01), id="table", marks=pytest.mark.slow),
    ],
)
def test_a_held_body_is_not_carried_round_an_edge(scene, settings, tolerance):
    """It would fly off at t = 0.4; the laws of a held contact know nothing of that, so the motion ends."""
    motion = run(scene(jnp.array([9.81, 0.5])), [-0.6, 0.0], [1.5, 0.0], 0.8, ts=TS, rtol=tolerance, atol=tolerance,
                 **settings)  # fmt: skip
    ends_at(motion, 0.4)
    assert_close(motion.final.q, [0.0, 0.0], 1e-12, scale=1.0)
    assert_close(motion.final.v, [1.5, 0.0], 1e-12)


@pytest.mark.slow
def test_a_valley_of_one_gap_ends_the_motion_and_of_two_does_not():
    """The impact in the valley is an event of two gaps, and none of their minimum."""
    motion = run(Valley(jnp.array([9.81, 0.0])), [1.0, 0.6], [0.0, 0.0], 0.8, ts=TS)
    assert motion.status == hs.Status.gap_not_smooth
    assert_close(motion.final.q, [0.0, 0.0], 1e-12, scale=1.0)
    assert "two gaps" in hs.Status[motion.status]


@pytest.mark.slow
def test_a_rounded_edge_is_followed():
    """A body that is put on it slides down, and none of its energy is lost."""
    scene = RoundedRoof(jnp.array([9.81, 0.5]))
    y = 0.0
    for _ in range(30):
        y = y - float(scene.gap(0.0, jnp.array([0.0, y]))[0])
    motion = run(scene, [0.0, y], [0.0, 0.0], 0.3, rtol=1e-10, atol=1e-10)
    assert motion.status == hs.Status.successful and bool(motion.mode[0])
    assert_close(motion.final.v @ motion.final.v / 2, 9.81 * (y - float(motion.final.q[1])), 1e-8)


WAYS = {
    "bouncing": (9.81, 1.0, 0.0),
    "rising": (0.0, 0.5, 0.1),
    "still": (0.0, 0.5, 0.0),
    "falling": (0.0, 0.5, -0.1),
    "held": (9.81, 0.0, 0.0),
}
"""Weight, height and velocity."""


@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=[pytest.mark.slow] * (way not in ("held", "bouncing"))) for way in WAYS]
)
def test_a_gap_that_jumps_through_a_body_ends_the_motion(way):
    """Whatever the body does at that time: the status names the cause, and no steps are wasted."""
    weight, q, v = WAYS[way]
    motion = run(Step(jnp.array(weight)), [q], [v], 2.0, ts=jnp.linspace(0, 2, 201))
    ends_at(motion, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["held", "bouncing"])
def test_nor_may_it_jump_at_a_declared_time(way):
    """The step that cannot be taken begins behind the jump."""
    weight, q, v = WAYS[way]
    ends_at(run(Step(jnp.array(weight)), [q], [v], 2.0, ts=jnp.linspace(0, 2, 201), jump_ts=jnp.array([1.0])), 1.0)


class Thrust(Step):
    """A thrust of twice the weight from t = 1 on, at rest on a floor."""

    def force(self, t, q, v):
        return jnp.where(t < 1, -self.weight, self.weight)[None]

    def gap(self, t, q):
        return q


def test_a_multiplier_that_jumps_below_zero_lets_go():
    """It falls through zero at no rate at all: the contact opens, and the body rises with weight / 2 (t - 1)^2."""
    motion = run(Thrust(jnp.array(9.81)), [0.0], [0.0], 2.0)
    assert motion.status == hs.Status.successful
    assert motion.events.count == 1 and motion.events.kind[0] == hs.EventKind.RELEASE
    assert_close(motion.final.q, [9.81 / 2], 1e-10)


class Hills(Slider):
    """Smooth hills that move."""

    def gap(self, t, q):
        return (q[1] - 0.1 * jnp.sin(2 * q[0] + 0.3 * t))[None]


@pytest.mark.slow
@pytest.mark.parametrize("tolerance, steps", [(1e-8, 140), (1e-12, 700)])
def test_on_smooth_ground_the_projection_costs_no_steps(tolerance, steps):
    """What it moves is below the solver's own error."""
    motion = run(Hills(jnp.array([9.81, 0.0])), [0.3, 0.5], [1.0, 0.0], 6.0, rtol=tolerance, atol=tolerance)
    assert motion.status == hs.Status.successful
    assert motion.steps.accepted + motion.steps.rejected <= steps
