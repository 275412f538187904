"""A pendulum with a motor, piecewise linear in time, that strikes a wall; a start in contact."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array, lax

import hybridsens as hs

KNOTS = jnp.array([0.0, 0.13, 0.31, 0.5, 0.72, 0.9, 1.17, 1.4, 1.62, 2.0])
TORQUES = jnp.array([0.0, 3.0, -4.0, -6.0, 2.0, 5.0, -7.0, 1.0, -3.0, 4.0])
START = jnp.array([1.0, 0.0])
HORIZON = 2.0
RESTITUTION = 0.8


class Pendulum(hs.AbstractScene):
    """A pendulum beside a wall at its lowest point, with a motor."""

    knots: Array
    torques: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return acceleration(self.knots, self.torques, t, q)

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.array([RESTITUTION])

    def jump_times(self):
        return self.knots


def acceleration(knots, torques, t, q):
    return -9.81 * jnp.sin(q) + jnp.interp(t, knots, torques)


@functools.cache
def solved():
    """(knots, torques, tolerance) -> ((q(T), motion), gradient); with room for the two impacts and no more."""

    def cost(knots, torques, tolerance):
        start = hs.State(START[:1], START[1:])
        motion = hs.simulate(
            Pendulum(knots, torques), start, t1=HORIZON, rtol=tolerance, atol=tolerance, max_events=IMPACTS,
        )  # fmt: skip
        return motion.final.q[0], motion

    return jax.jit(jax.value_and_grad(cost, argnums=(0, 1), has_aux=True))


IMPACTS = 2
STEPS = 400
"""Steps of the reference from knot to knot."""


@jax.jit
def _fly(knots, torques, x, t0, t1):
    """Runge-Kutta's method of order 4 from t0 to t1, none of whose steps holds a knot."""
    h = (t1 - t0) / STEPS
    rate = lambda t, x: jnp.stack([x[1], acceleration(knots, torques, t, x[0])])

    def step(x, i):
        t = t0 + i * h
        a = rate(t, x)
        b = rate(t + h / 2, x + h / 2 * a)
        c = rate(t + h / 2, x + h / 2 * b)
        d = rate(t + h, x + h * c)
        return x + h / 6 * (a + 2 * b + 2 * c + d), None

    return lax.scan(step, x, jnp.arange(STEPS))[0]


def _reference(knots, torques):
    """q(T), from knot to knot and from impact to impact; times of impact by Newton's method."""
    x, times = START, []
    for t0, t1 in zip(knots[:-1], knots[1:], strict=True):
        end = _fly(knots, torques, x, t0, t1)
        while end[0] < 0:
            t = (t0 + t1) / 2
            for _ in range(20):
                t = lax.stop_gradient(t)
                hit = _fly(knots, torques, x, t0, t)
                t = t - hit[0] / lax.stop_gradient(hit[1])
            hit = _fly(knots, torques, x, t0, t)
            times.append(lax.stop_gradient(t))
            x, t0 = jnp.stack([jnp.zeros(()), -RESTITUTION * hit[1]]), t
            end = _fly(knots, torques, x, t0, t1)
        x = end
    return x[0], jnp.stack(times)


@functools.cache
def reference():
    """((q(T), times of impacts), gradient)."""
    return jax.value_and_grad(_reference, argnums=(0, 1), has_aux=True)(KNOTS, TORQUES)


def errors(tolerance):
    """Of value, times of impacts, and the gradients by knots and torques, the latter relative to their largest."""
    (value, motion), found = solved()(KNOTS, TORQUES, jnp.asarray(tolerance))
    (true_value, times), truth = reference()
    worst = lambda x: float(jnp.max(jnp.abs(x)))
    relative = [worst(a[1:-1] - b[1:-1]) / worst(b[1:-1]) for a, b in zip(found, truth, strict=True)]
    return abs(float(value - true_value)), worst(motion.events.time - times), *relative


@pytest.mark.slow
def test_the_gradient_by_knots_is_right_and_follows_the_tolerance():
    """Steps that ran over a knot would cost all but four digits."""
    usual, tight = errors(1e-8), errors(1e-11)
    assert usual[0] < 1e-7 and usual[1] < 1e-7
    assert usual[2] <= 1e-7 and usual[3] <= 1e-7
    assert tight[2] <= 2e-9 and tight[3] <= 2e-9
    assert errors(1e-5)[2] > usual[2] > tight[2]


@pytest.mark.slow
def test_events_are_told_and_knots_are_not():
    """Ten knots take no room among the events."""
    (_, motion), _ = solved()(KNOTS, TORQUES, jnp.asarray(1e-8))
    assert motion.status == hs.Status.successful and motion.events.count == IMPACTS == reference()[0][1].size
    assert (np.asarray(motion.events.kind) == 0).all() and (np.asarray(motion.events.contact) == 0).all()
    np.testing.assert_allclose(motion.events.after.v, -RESTITUTION * motion.events.before.v, rtol=1e-12)


class Floor(hs.AbstractScene):
    """A ball that starts at rest on a floor at height c."""

    c: Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.array([-9.81])

    def gap(self, t, q):
        return q - self.c

    def restitution(self):
        return jnp.array([0.3])


@pytest.mark.slow
@pytest.mark.parametrize("forward", [False, True])
def test_a_start_in_contact_forgets_its_state(forward):
    """J = q(T) + int q dt: the contact holds the ball from the start, so only the floor counts, 1 + T."""

    def cost(p):
        adjoint = hs.ForwardSensitivities() if forward else hs.Replay()
        height = lambda scene, t, q, v: q[0]
        start = hs.State(p[1:2], p[2:])
        motion = hs.simulate(Floor(p[0]), start, t1=1.2, running_cost=height, adjoint=adjoint)
        return motion.final.q[0] + motion.cost

    slope = jax.jit((jax.jacfwd if forward else jax.grad)(cost))(jnp.zeros(3))
    np.testing.assert_allclose(slope, [2.2, 0, 0], rtol=1e-12, atol=1e-12)
