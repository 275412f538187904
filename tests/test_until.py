"""A motion that ends with an event: where and how it ends, and derivatives of both, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.jacobians import value_and_jacobian
from tests.problems.balls import RestlessBall
from tests.problems.hybrid_systems import Oscillator
from tests.problems.switched_scenes import Relay

DROPPED = hs.State(jnp.array([1.0]), jnp.array([0.0]))
TIGHT = dict(rtol=1e-11, atol=1e-11, max_events=8, max_steps=256)
REPLAY, FORWARD, ANY = hs.Replay(), hs.ForwardSensitivities(), hs.AnyMode()
LATER = [pytest.param(adjoint, marks=pytest.mark.slow) for adjoint in (FORWARD, hs.Replay(recompute=True))]
third = lambda model, event: event.count == 3


def dropped(p, adjoint=None, until=third, **settings):
    ball, cost, how = RestlessBall(p[0], p[1]), lambda scene, t, q, v: v @ v, {**TIGHT, **settings}
    return hs.simulate(ball, DROPPED, t1=9.0, until=until, running_cost=cost, adjoint=adjoint, **how)


def end_of_third(p):
    """When a ball dropped from 1 hits for the third time, how fast it leaves, and its integral of v^2, which is
    2 weight H / 3 over each rise or fall of height H and time (2 H / weight)^(1/2)."""
    weight, e = p
    fall, speed = jnp.sqrt(2 / weight), jnp.sqrt(2 * weight)
    path = 1 + 2 * e**3 + 2 * e**6
    return jnp.stack([fall * (1 + 2 * e + 2 * e**2), e**3 * speed, 2 * weight / 3 * fall * path])


@pytest.mark.parametrize("adjoint", [REPLAY, ANY, *LATER])
def test_a_scene_ends_with_its_third_impact(adjoint):
    """The state at the end moves with the event: that of the moment would miss the speed times the time's own shift."""
    p = jnp.array([9.81, 0.8])

    def ended(p, adjoint):
        motion = dropped(p, adjoint)
        return jnp.stack([motion.end_time, motion.final.v[0], motion.cost])

    value, jacobian = value_and_jacobian(ended, adjoint)(p)
    assert_close(value, end_of_third(p), 1e-10)
    assert_close(jacobian, jax.jacfwd(end_of_third)(p), 1e-9)


@pytest.mark.slow
def test_second_derivatives_and_the_beginning():
    p = jnp.array([9.81, 0.8])
    found = jax.jit(jax.hessian(lambda p: dropped(p).end_time))(p)
    assert_close(found, jax.hessian(lambda p: end_of_third(p)[0])(p), 1e-8)

    def ended(height, t0, t1):
        start = hs.State(height[None], jnp.zeros(1))
        ball = RestlessBall(*p)
        return hs.simulate(ball, start, t0=t0, t1=t1, until=third, **TIGHT).end_time

    # All times go as the square root of the height; t1 comes later than the end.
    found = jax.grad(ended, (0, 1, 2))(jnp.array(1.0), 0.25, 9.0)
    assert_close(jnp.stack(found), jnp.stack([end_of_third(p)[0] / 2, 1.0, 0.0]), 1e-9)


def test_samples_behind_the_end_are_nan_and_nothing_depends_on_them():
    p, ts = jnp.array([9.81, 0.8]), jnp.array([0.2, 1.0, 3.0, 8.0])

    def seen(p):
        """The first fall, and the flight after it."""
        since = ts[1] - jnp.sqrt(2 / p[0])
        flown = p[1] * jnp.sqrt(2 * p[0]) * since - p[0] / 2 * since**2
        return jnp.stack([1 - p[0] / 2 * ts[0] ** 2, flown])

    sampled = lambda p: (lambda q: (jnp.nansum(q), q))(dropped(p, ts=ts).q[:, 0])
    derivative, q = jax.grad(sampled, has_aux=True)(p)
    assert np.isnan(q[2:]).all()
    assert_close(q[:2], seen(p), 1e-9)
    assert_close(derivative, jax.grad(lambda p: jnp.sum(seen(p)))(p), 1e-9)


def test_a_motion_that_does_not_meet_its_event_goes_on_to_t1():
    p = jnp.array([9.81, 0.8])
    never = lambda scene, event: event.time > 100
    motion, whole = (hs.simulate(RestlessBall(*p), DROPPED, t1=1.0, until=until, **TIGHT) for until in (never, None))
    assert motion.end_time == 1.0 and motion.status == hs.Status.successful
    assert_close(motion.final.q, whole.final.q, 1e-14)
    assert "ended with" not in str(motion)


def test_a_batch_ends_one_by_one():
    """A motion that has ended takes no more steps."""
    es = jnp.array([0.1, 0.5, 0.9])

    def ended(e):
        motion = dropped(jnp.stack([jnp.array(9.81), e]))
        return motion.end_time, motion.steps.accepted

    (times, steps), derivatives = jax.vmap(jax.value_and_grad(ended, has_aux=True))(es)
    assert_close(times, jax.vmap(lambda e: end_of_third(jnp.stack([jnp.array(9.81), e]))[0])(es), 1e-10)
    assert_close(derivatives, np.sqrt(2 / 9.81) * (2 + 4 * es), 1e-9)
    assert (steps < 60).all()  # some 8 a flight


@pytest.mark.parametrize("adjoint", [REPLAY, FORWARD])
def test_a_system_ends_by_its_mode(adjoint):
    """x = cos(w t) falls through 0 at w t = pi/2 + 2 pi k; its integral of x^2 up to there is half of that time."""
    w = jnp.array(1.7)

    def ended(w, adjoint):
        until = lambda system, event: event.mode == 2
        found = hs.solve(
            Oscillator(w), jnp.array([1.0, 0.0]), 0, t1=30.0, until=until, adjoint=adjoint,
            running_cost=lambda system, t, x, mode: x[0] ** 2, rtol=1e-10, atol=1e-10, max_events=8, max_steps=512,
        )  # fmt: skip
        return jnp.stack([found.end_time, found.final[1], found.cost, found.events.time[1]])

    time = lambda w: 2.5 * jnp.pi / w
    value, derivative = value_and_jacobian(ended, adjoint)(w)
    exact = lambda w: jnp.stack([time(w), -w, time(w) / 2, time(w)])
    assert_close(value, exact(w), 1e-9)
    assert_close(derivative, jax.jacfwd(exact)(w), 1e-8)


def test_the_event_is_a_row_of_the_table():
    """A switch is numbered as in `events`, and jump times are no events."""
    relay = Relay(1.0, 0.4, 0.1)
    run = lambda until: hs.simulate(
        relay, hs.State(jnp.array([1.0]), jnp.zeros(1)), jnp.array(0), t1=6.0, jump_ts=jnp.array([0.1, 0.2]),
        until=until, max_events=16, max_steps=512,
    )  # fmt: skip
    whole = run(None).events
    assert whole.count > 2
    row = jax.tree.map(lambda rows: rows[1], (whole.time, whole.after.v, whole.mode))

    def is_second(scene, event):
        matches = (event.kind == hs.EventKind.SWITCH) & (event.contact == 0) & (event.mode == row[2])
        return matches & (event.count == 2) & (jnp.abs(event.after.v[0] - row[1][0]) < 1e-9)

    motion = run(is_second)
    assert motion.events.count == 2 and motion.scene_mode == row[2]
    assert_close(motion.end_time, row[0], 1e-12)


class Ticked(hs.AbstractHybridSystem):
    """x' = 1; at the scheduled time x grows tenfold."""

    at: jax.Array

    def flow(self, t, x, mode):
        return jnp.ones(())

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return self.at[None]

    def transition(self, event, t, x, mode):
        return 10 * x, mode


@pytest.mark.parametrize("adjoint", [REPLAY, LATER[0]])
def test_it_may_end_at_t1_and_at_t0(adjoint):
    """Then it has ended with the event all the same: with (at, 10 (at - t0))."""

    def ended(p, adjoint):
        at, t0, t1 = p
        found = hs.solve(
            Ticked(at), 0.0, t0=t0, t1=t1, until=lambda system, event: True, adjoint=adjoint, max_events=2, max_steps=16
        )
        return jnp.stack([found.end_time, found.final])

    run = value_and_jacobian(ended, adjoint)
    for at in (1.0, 0.0):  # t1 and t0
        value, jacobian = run(jnp.array([at, 0.0, 1.0]))
        assert_close(value, np.array([at, 10 * at]), 1e-12, 1.0)
        assert_close(jacobian, np.array([[1.0, 0, 0], [10, -10, 0]]), 1e-10)


def test_a_growth_is_that_up_to_the_end():
    """However much later t1 is."""
    grown = lambda t1: hs.lyapunov(RestlessBall(9.81, 0.8), DROPPED, t1=t1, until=third, **TIGHT).exponent
    assert_close(grown(3.0), grown(9.0), 1e-12)


class Folded(hs.AbstractHybridSystem):
    """x' = -1 at x > 0, -2 below: a comparison, located as an event."""

    located_discontinuities = True

    def flow(self, t, x, mode):
        return jnp.where(x > 0, -1.0, -2.0)

    def guards(self, t, x, mode):
        return (x + 9.0)[None]

    def transition(self, event, t, x, mode):
        return x, mode


def test_a_comparison_ends_a_motion_too():
    motion = hs.solve(Folded(), 1.5, t1=9.0, until=lambda system, event: event.guard == 1, max_events=4, max_steps=64)
    assert_close(motion.end_time, np.array(1.5), 1e-9)


@pytest.mark.slow
def test_what_is_asked_of_a_motion_afterwards():
    ball = RestlessBall(9.81, 0.8)
    motion = hs.simulate(ball, DROPPED, t1=9.0, ts=jnp.array([0.0, 1.0]), until=third, **TIGHT)
    assert str(motion).startswith("status: successful; ended with event 2, at t = 1.7519")
    assert np.isfinite(motion.evaluate([1.0, float(motion.end_time)]).q).all()
    with pytest.raises(ValueError, match=r"within \[t0, t1\] = \[0, 1.7519.*but 1.9 does not"):
        motion.evaluate([1.9])
    with pytest.raises(ValueError, match="this one has `until`"):
        hs.costate(motion, lambda motion: motion.final.q[0])


@pytest.mark.parametrize(
    "until, told",
    [
        (3, r"a function of \(scene, event\), but is int"),
        (lambda scene: True, r"a function of \(scene, event\), but is `<lambda>\(scene\)`"),
        (lambda scene, event: 1, "one boolean, but returns int"),
        (lambda scene, event: None, "one boolean, but returns NoneType"),
        (lambda scene, event: event.after.v > 0, r"one boolean, but returns bool of shape \(1,\)"),
        (lambda scene, event: event.count == 3 and event.contact == 0, "write `&` and `|`"),
    ],
)
def test_refused(until, told, unchecked):
    with pytest.raises(TypeError, match=told):
        dropped(jnp.array([9.81, 0.8]), until=until)


def test_what_is_closed_over_is_not_traced():
    """It would be missed by the derivative rule, or by a batch."""
    with pytest.raises(TypeError, match="closes over a value that JAX traces: make it a field of the RestlessBall"):
        jax.vmap(lambda n: dropped(jnp.array([9.81, 0.8]), until=lambda scene, event: event.count == n).end_time)(
            jnp.arange(1, 3)
        )


@pytest.mark.slow
def test_studies_take_it():
    ball, cost = RestlessBall(9.81, 0.8), lambda ball, simulate: simulate(ball, DROPPED, t1=9.0, until=third).end_time
    checked = hs.check_gradient(ball, cost)
    assert "All agree." in str(checked) and "Likely cause" not in str(checked)
    failed = [row for row in hs.compare(ball, cost).rows if "cannot end with an event" in str(row)]
    assert len(failed) == 5
