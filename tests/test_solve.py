"""Hybrid systems that are not mechanical, against closed forms."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

import hybridsens as hs
from tests.closeness import assert_close
from tests.jacobians import value_and_jacobian
from tests.problems.hybrid_systems import Ball, Dominoes, Lines, Neuron, Oscillator, Overflow, Thermostat

REVERSE, FORWARD = hs.Replay(), hs.ForwardSensitivities()
BOTH = pytest.mark.parametrize("adjoint", [REVERSE, FORWARD], ids=["reverse", "forward"])
ONE = pytest.mark.parametrize(
    "adjoint", [REVERSE, pytest.param(FORWARD, marks=pytest.mark.slow)], ids=["reverse", "forward"]
)
"""Where what is told of forward mode is told elsewhere too."""
TIGHT = dict(rtol=1e-12, atol=1e-12)


@pytest.mark.slow
@BOTH
def test_a_thermostat_has_its_closed_form(adjoint):
    """Three switches, the last temperature, and a running cost that jumps with the mode, by all parameters and x0."""

    def computed(p, adjoint):
        used = lambda system, t, x, mode: jnp.where(mode["on"], system.heat, 0)
        start, off = {"inside": p[5]}, {"on": False, "count": 0}
        made = hs.solve(
            Thermostat(*p[:5]), start, off, t1=3.2, running_cost=used, max_events=8, adjoint=adjoint, **TIGHT
        )
        return jnp.concatenate([made.events.time[:3], jnp.stack([made.final["inside"], made.cost])])

    def exact(p):
        a, outside, heat, low, high, x0 = p
        hot = outside + heat / a
        t_on = jnp.log((x0 - outside) / (low - outside)) / a
        t_off = t_on + jnp.log((hot - low) / (hot - high)) / a
        t_on_again = t_off + jnp.log((high - outside) / (low - outside)) / a
        final = hot + (low - hot) * jnp.exp(-a * (3.2 - t_on_again))
        return jnp.stack([t_on, t_off, t_on_again, final, heat * (t_off - t_on + 3.2 - t_on_again)])

    p = jnp.array([0.3, 10.0, 9.0, 18.0, 22.0, 20.0])
    value, derivative = value_and_jacobian(computed, adjoint)(p)
    assert_close(value, exact(p), 1e-9)
    assert_close(derivative, jax.jacfwd(exact)(p), 1e-9)


@pytest.mark.slow
@ONE
def test_a_neuron_has_its_closed_form(adjoint):
    """Spike k comes tau log(i_k / (i_k - 1)) after the one before, with i_k = i + k w."""

    def computed(p, adjoint):
        start = {"v": 0.0, "i": p[2]}
        return hs.solve(Neuron(*p[:2]), start, t1=1.6, max_events=4, adjoint=adjoint, **TIGHT).events.time[:4]

    def exact(p):
        i = p[2] + p[1] * jnp.arange(4)
        return jnp.cumsum(p[0] * jnp.log(i / (i - 1)))

    p = jnp.array([0.5, 0.3, 1.6])
    value, derivative = value_and_jacobian(computed, adjoint)(p)
    assert_close(value, exact(p), 1e-9)
    assert_close(derivative, jax.jacfwd(exact)(p), 1e-9)


@pytest.mark.slow
def test_a_ball_is_that_of_the_scene():
    """Events, samples, final state and gradient to rounding."""
    ts = jnp.linspace(0.0, 2.0, 9)

    def general(p):
        made = hs.solve(Ball(p[0], p[1]), jnp.array([1.0, 0.0]), t1=2.0, ts=ts, max_events=8)
        return jnp.concatenate([made.final, made.events.time[:3], made.x[:, 0]])

    def scene(p):
        ball = hs.scenes.BouncingBall(mass=1.0, weight=p[0], restitution_coefficient=p[1])
        made = hs.simulate(ball, hs.State(jnp.array([1.0]), jnp.array([0.0])), t1=2.0, ts=ts, max_events=8)
        return jnp.concatenate([made.final.q, made.final.v, made.events.time[:3], made.q[:, 0]])

    p = jnp.array([9.81, 0.8])
    assert_close(general(p), scene(p), 1e-12)
    assert_close(jax.jacrev(general)(p), jax.jacrev(scene)(p), 1e-11)


@ONE
@pytest.mark.parametrize("start", [1.0, -1.0])
def test_a_section_is_passed_downward_only(adjoint, start):
    """From above and from below 0: every period once, and none of the silent rises is reported."""
    first = jnp.pi / 2 if start > 0 else 3 * jnp.pi / 2

    def times(w, adjoint):
        x0 = jnp.array([start, 0.0])
        made = hs.solve(Oscillator(w), x0, 0, t1=11.0, max_events=3, adjoint=adjoint, throw=False, **TIGHT)
        return jnp.append(made.events.time[:3], made.mode)

    value, derivative = value_and_jacobian(times, adjoint)(jnp.array(2.0))
    expected = (first + 2 * jnp.pi * jnp.arange(3)) / 2
    assert_close(value, jnp.append(expected, 3), 1e-9)
    assert_close(derivative, jnp.append(-expected / 2, 0), 1e-9)


@ONE
def test_an_event_that_fires_another_at_once(adjoint):
    """Both move together: t = x0 / speed, and x(t1) = height + more t - speed (t1 - t)."""

    def computed(p, adjoint):
        made = hs.solve(Dominoes(*p[:3]), jnp.stack([p[3], 1.0]), t1=1.5, max_events=4, adjoint=adjoint, **TIGHT)
        return jnp.stack([*made.events.time[:2], made.final[0], made.events.count.astype(float)])

    def exact(p):
        speed, height, more, x0 = p
        t = x0 / speed
        return jnp.stack([t, t, height + more * t - speed * (1.5 - t), jnp.array(2.0)])

    p = jnp.array([1.3, 2.0, 0.7, 1.1])
    value, derivative = value_and_jacobian(computed, adjoint)(p)
    assert_close(value, exact(p), 1e-9)
    assert_close(derivative, jax.jacfwd(exact)(p), 1e-9)


def test_guards_that_fall_almost_together_fire_in_their_order():
    """Lines 3e-7 apart; then one whose kick takes the other back before it is met."""
    at = jnp.array([0.5 - 3e-7, 0.5])
    made = hs.solve(Lines(at, jnp.zeros(2)), 1.0, t1=1.0)
    np.testing.assert_array_equal(made.events.guard[:2], [1, 0])
    assert_close(made.events.time[:2], jnp.array([0.5, 0.5 + 3e-7]), 1e-14)
    back = hs.solve(Lines(at, jnp.array([0.0, 0.25])), 1.0, t1=0.7)
    assert int(back.events.count) == 1


def test_a_guard_may_start_on_zero_without_a_rate():
    """At t = 1 it stops overflowing: full - h is 0 there with rate 0, and grows as (t - 1)^2 / 2."""
    final = lambda full: ((made := hs.solve(Overflow(full), 0.0, 0, t1=3.0, max_events=4)).final, made)
    slope, made = jax.grad(final, has_aux=True)(jnp.array(0.3))
    assert_close(made.events.time[:2], jnp.array([1 - jnp.sqrt(0.4), 1.0]), 1e-9)
    assert_close(made.final, jnp.array(0.3 - 2.0), 1e-9)
    assert_close(slope, jnp.array(1.0), 1e-9)


class Subtracting(hs.AbstractHybridSystem):
    """A leaking store that gives off 1 at a time as long as it holds more; it is filled at a given time."""

    amount: jax.Array
    at: jax.Array

    def flow(self, t, x, mode):
        return -x

    def guards(self, t, x, mode):
        return (1.0 - x)[None]

    def scheduled_times(self, x, mode):
        return self.at[None]

    def transition(self, event, t, x, mode):
        return jnp.where(event == 0, x - 1.0, x + self.amount), mode


@pytest.mark.slow
@ONE
def test_a_guard_that_its_own_event_leaves_below_zero_fires_again(adjoint):
    """Filled by 3.3 at 0.5 it gives off three times at once: x(1) = (x0 e^-0.5 + 3.3 - 3) e^-0.5."""
    final = lambda p, adjoint: hs.solve(Subtracting(*p[:2]), p[2], t1=1.0, max_events=8, adjoint=adjoint, **TIGHT).final
    exact = lambda p: (p[2] * jnp.exp(-p[1]) + p[0] - 3.0) * jnp.exp(p[1] - 1.0)
    p = jnp.array([3.3, 0.5, 0.2])
    value, slope = value_and_jacobian(final, adjoint)(p)
    assert_close(value, exact(p), 1e-11)
    assert_close(slope, jax.grad(exact)(p), 1e-10)
    too_much = hs.solve(Subtracting(jnp.array(20.0), jnp.array(0.5)), 0.2, t1=1.0, max_events=4, throw=False)
    assert too_much.status == hs.Status.max_events_reached
    np.testing.assert_array_equal(too_much.events.guard, [1, 0, 0, 0])


def test_what_chatters_says_so():
    """One threshold both ways; and what is raised shows the modes."""
    room = Thermostat(*map(jnp.array, (0.3, 10.0, 9.0, 20.0, 20.0)))
    chatter = lambda throw: hs.solve(room, {"inside": 21.0}, {"on": False, "count": 0}, t1=3.0, throw=throw)
    assert chatter(False).status == hs.Status.event_repeats
    assert "thresholds apart" in str(chatter(False))
    seen = "The last events: t = 0.317700599, event 0 to mode {'count': 1, 'on': True}"
    with pytest.raises(hs.SimulationError, match=seen):
        chatter(True)


class SteepGuard(hs.AbstractHybridSystem):
    """x' = a (1.3 - x), back to 0 at x = 1: told by a guard that is up to 1e17 before, and of ordinary slope there."""

    a: Array
    guard: Callable[[Array], Array] = eqx.field(static=True)

    def flow(self, t, x, mode):
        return self.a * (1.3 - x)

    def guards(self, t, x, mode):
        return self.guard(x)[None]

    def transition(self, event, t, x, mode):
        return 0 * x, mode


STEEP = {
    "sinh": lambda x: jnp.sinh(40 * (1 - x)),
    "exp": lambda x: jnp.exp(30 * (1 - x)) - 1,
    "power": lambda x: ((x + 0.1) / 1.1) ** -12 - 1,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sinh", "exp", "power"])
def test_a_guard_that_was_large_falls_at_its_zero(name):
    """Rounding is relative to what a guard is near its zero, not to what it was far from it: a x1 = log(1.3 / 0.3)."""
    run = lambda a: hs.solve(SteepGuard(a, STEEP[name]), 0.0, t1=3.3, max_events=8)
    second, slope = jax.value_and_grad(lambda a: run(a).events.time[1])(jnp.array(1.0))
    exact = 2 * np.log(1.3 / 0.3)
    assert int(run(jnp.array(1.0)).events.count) == 2
    assert_close(second, exact, 1e-8)
    assert_close(slope, -exact, 1e-7)


class Settling(hs.AbstractHybridSystem):
    """x' = level - x, watched for passing the level, which it comes near and never passes."""

    level: Array

    def flow(self, t, x, mode):
        return self.level - x

    def guards(self, t, x, mode):
        return (self.level - x)[None]

    def transition(self, event, t, x, mode):
        return x, mode


def test_a_motion_that_settles_on_a_threshold_goes_on():
    """There the guard is nothing but rounding, which must not be looked into: it would take thousands of steps."""
    made = hs.solve(Settling(jnp.array(0.7)), 0.1, t1=300.0, max_events=8)
    assert made.steps.accepted + made.steps.rejected < 1000
    assert_close(made.final, 0.7, 1e-9)
