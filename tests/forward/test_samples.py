"""States at the times asked for, across all events, and how they move with those times and with the horizon."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall

WITHIN = 1e-7


def observed(p, t0, t1, ts):
    """(samples, both sides of the first event, integral of v^2), and the trajectory."""
    settings = dict(rtol=1e-10, atol=1e-10, max_events=4, max_steps=1000, throw=False)
    speed = lambda scene, t, q, v: v[0] ** 2
    ball, start = RestlessBall(p[2], p[3]), hs.State(p[:1], p[1:2])
    trajectory = hs.simulate(ball, start, t0=t0, t1=t1, ts=ts, running_cost=speed, **settings)
    samples = jnp.concatenate([trajectory.q, trajectory.v], axis=1)
    sides = [jnp.stack([side.q[0, 0], side.v[0, 0]]) for side in (trajectory.events.before, trajectory.events.after)]
    seen = samples, jnp.stack(sides), trajectory.cost
    return seen, (seen, trajectory)


compiled = jax.jit(jax.jacrev(observed, argnums=(0, 1, 2, 3), has_aux=True))


def solve(p, ts, t0=0.0, t1=2.5):
    jacobian, (seen, trajectory) = compiled(*(jnp.asarray(part, float) for part in (p, t0, t1, ts)))
    assert trajectory.status == hs.Status.successful
    return seen, jacobian, trajectory


EVERY_HALF_SECOND = np.arange(6) / 2
P12 = (5.0, 0.0, 9.8, 0.8)


@pytest.mark.parametrize(
    "with_events, value, gradient",
    [
        (True, -6.483081014213355, [11.039191898579, 8.0451762594181, -6.2937796435823, 68.994949366117]),
        (False, -4.503182026891021, [11.237181797311, 8.0451762594181, -6.1927643891271, 59.095454429505]),
    ],
)
def test_sum_of_saved_states(with_events, value, gradient):
    """SciML's callback test: the sum of all that is saved, with both sides of the event and without."""
    (samples, sides, _), (d_samples, d_sides, _), _ = solve(P12, EVERY_HALF_SECOND)
    found, by_p = jnp.sum(samples), jnp.sum(d_samples[0], axis=(0, 1))
    if with_events:
        found, by_p = found + jnp.sum(sides), by_p + jnp.sum(d_sides[0], axis=(0, 1))
    assert_close(found, value, WITHIN)
    assert_close(by_p, gradient, WITHIN)


def test_running_cost_that_jumps_at_an_impact():
    """The integral of v^2 over one impact with e < 1, where l- - l+ in (T8) is not zero."""
    (_, _, cost), (_, _, by), trajectory = solve((5.0, 0.0, 9.81, 0.8), EVERY_HALF_SECOND)
    assert_close(cost, 60.1239653563004, WITHIN)
    assert_close(by[0][jnp.array([0, 2, 3])], [6.8253398804193, 8.7789226616212, 18.109466068155], WITHIN)
    assert_close(by[2], trajectory.final.v[0] ** 2, WITHIN)
    assert_close(by[1], -(trajectory.final.v[0] ** 2), WITHIN)


def test_states_and_their_derivatives_by_the_times():
    """A sample moves with its own time as the flow says, and against t0, because nothing here depends on the date."""
    ts = [0.0, 0.3, 0.95, 1.6, 2.2, 2.5]
    p = (5.0, -1.0, 9.8, 0.8)
    (samples, _, _), (by, _, _), trajectory = solve(p, ts)
    t_impact = float(trajectory.events.time[0])
    up = 0.8 * np.sqrt(1 + 2 * 9.8 * 5)
    falls = lambda t: (5 - t - 4.9 * t**2, -1 - 9.8 * t)
    rises = lambda t: (up * (t - t_impact) - 4.9 * (t - t_impact) ** 2, up - 9.8 * (t - t_impact))
    assert_close(samples, [falls(t) if t < t_impact else rises(t) for t in ts], WITHIN)
    flow = np.stack([np.asarray(samples[:, 1]), np.full(6, -9.8)], axis=1)
    assert_close(by[3][jnp.arange(6), :, jnp.arange(6)], flow, WITHIN)
    assert_close(by[3] - np.einsum("si,sj->sij", flow, np.eye(6)), np.zeros((6, 2, 6)), 1e-9, scale=1.0)
    assert_close(by[1], -flow, WITHIN)
    assert_close(by[2][:-1], np.zeros((5, 2)), 1e-9, scale=1.0)


def test_a_sample_at_an_event_is_the_state_after_it():
    """And so is its derivative: that of a fixed time just after."""
    _, _, trajectory = solve(P12, EVERY_HALF_SECOND)
    t = float(trajectory.events.time[0])
    (samples, sides, _), (by, _, _), _ = solve(P12, [t, t + 1e-9, 2.0, 2.0, 2.5, 2.5])
    assert_close(samples[0], sides[1], 1e-12)
    assert_close(by[0][0], by[0][1], 1e-7)
    assert_close(samples[2:4], samples[jnp.array([3, 2])], 1e-15)


@pytest.mark.parametrize("adjoint", [hs.Replay(), pytest.param(hs.ForwardSensitivities(), marks=pytest.mark.slow)])
def test_a_sample_at_the_end_is_the_state_after_the_impact_there(adjoint):
    """Without a force from 1 at speed -1, v(1) = -e v_0; no step is taken after the impact."""

    def velocity(v0, e):
        ball, settings = RestlessBall(jnp.array(0.0), e), dict(max_events=4, max_steps=64, adjoint=adjoint)
        return hs.simulate(ball, hs.State(jnp.array([1.0]), v0[None]), t1=1.0, ts=jnp.array([1.0]), **settings).v[0, 0]

    derivative = jax.jacfwd if adjoint.forward_mode else jax.grad
    assert_close(derivative(velocity, (0, 1))(jnp.array(-1.0), jnp.array(0.5)), [-0.5, 1.0], 1e-9)


def test_dates_only_shift_an_autonomous_motion():
    """Another t0 gives the same motion later."""
    (samples, _, cost), _, _ = solve(P12, EVERY_HALF_SECOND)
    (later, _, later_cost), _, _ = solve(P12, EVERY_HALF_SECOND + 7, t0=7.0, t1=9.5)
    assert_close(later, samples, 1e-10)
    assert_close(later_cost, cost, 1e-10)


class BallAndParticle(hs.AbstractScene):
    """A ball above a floor and a particle before a wall at 10, which do not meet; p = (x0, v0, y0, w0, g, e)."""

    sustained_contact = False
    p: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.stack([-self.p[4], 0 * self.p[4]])

    def gap(self, t, q):
        return jnp.stack([q[0], 10 - q[1]])

    def restitution(self):
        return jnp.broadcast_to(self.p[5], (2,))


def loss(p):
    """Half the sum of (1 - u)^2 over states saved every 0.5 up to 10, and over both sides of each event."""
    settings = dict(t1=10.0, ts=jnp.arange(21) / 2, rtol=1e-10, atol=1e-10, max_events=4, max_steps=1000)
    motion = hs.simulate(BallAndParticle(p), hs.State(p[0:3:2], p[1:4:2]), **settings)
    events = motion.events
    happened = (jnp.arange(4) < events.count)[:, None]
    states = [(motion, 1.0), (events.before, happened), (events.after, happened)]
    return sum(jnp.sum(weight * (1 - part) ** 2) / 2 for state, weight in states for part in (state.q, state.v))


loss_and_gradient = jax.jit(jax.value_and_grad(loss))


@pytest.mark.slow
@pytest.mark.parametrize(
    "w0, value, gradient",
    [
        (
            1.999,
            16014.567051736,
            [548.587464282, 78.0016572283, -247.341025268, -1345.59573996, 440.718215116, 39034.9178557],
        ),
        (
            2.001,
            16015.212882409,
            [548.431982436, 77.8827691331, -264.589012391, -1428.56779167, 440.975444916, 39027.9306549],
        ),
        (
            2.01,
            16002.37807317,
            [547.74312259, 77.3705669615, -265.140025821, -1423.44802332, 442.074949103, 38971.5875115],
        ),
    ],
)
def test_losses_on_both_sides_of_a_data_time_at_an_event(w0, value, gradient):
    """SciML #1447: where the particle hits at a save time (w0 = 2) the loss jumps between two gradients."""
    found, by_p = loss_and_gradient(jnp.array([50.0, 0.0, 0.0, w0, 9.8, 0.9]))
    assert_close(found, value, WITHIN)
    assert_close(by_p, gradient, WITHIN)
