"""Second derivatives after many events are as right as first ones, though each event moves farther than the one before:
against a closed form."""

import itertools

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close

W, MANY = 3.0, 60


class SwitchedRelay(hs.AbstractHybridSystem):
    """x goes to K, or to -K, until it has come to e on that side, at a pace that changes with time. It is watched where
    it falls through 0; that it has risen again is an event too, a silent one. At the parameters below the pace is even,
    but the Hessian by it asks for the time in the flow."""

    pace: jax.Array
    goal: jax.Array
    threshold: jax.Array

    def flow(self, t, x, mode):
        return (1 + self.pace * jnp.cos(W * t)) * (mode * self.goal - x)

    def guards(self, t, x, mode):
        return jnp.stack([self.threshold - mode * x, x])

    def transition(self, event, t, x, mode):
        return x, jnp.where(event == 0, -mode, mode)


def switch(p, number):
    """When it switches for that time, from 1 on: by the clock s = t + pace sin(W t) / W the flow is a decay."""
    pace, goal, threshold = p
    between = jnp.log((goal + threshold) / (goal - threshold))
    s = jnp.log(goal / (goal - threshold)) + (number - 1) * between
    t = s
    for _ in range(30):
        t = t - (t + pace * jnp.sin(W * t) / W - s) / (1 + pace * jnp.cos(W * t))
    return t


def state(p, number, t):
    """x after so many switches."""
    pace, goal, threshold = p
    clock = lambda t: t + pace * jnp.sin(W * t) / W
    side = 1 - 2 * (number % 2)
    decayed = jnp.exp(clock(switch(p, number)) - clock(t))
    return side * (goal - (goal + threshold) * decayed)


def motion(p, tolerance, adjoint, **asked):
    system = SwitchedRelay(*p)
    settings = dict(rtol=tolerance, atol=tolerance, max_events=2 * MANY, max_steps=8192, adjoint=adjoint)
    return hs.solve(system, 0.0, jnp.array(1), **asked, **settings)


P = jnp.array([0.0, 1.0, 0.2])
LAST = float(switch(P, MANY))
NEXT = float(switch(P, MANY + 1))
PLACES = LAST + jnp.array([0.2, 0.5, 0.9]) * (NEXT - LAST)


def time_of_switch(p, tolerance, adjoint):
    found = motion(p, tolerance, adjoint, t1=LAST + 0.3 * (NEXT - LAST))
    return found.events.times_of(0, MANY)[-1]


def later_states(p, tolerance, adjoint):
    return jnp.sum(motion(p, tolerance, adjoint, t1=NEXT - 1e-3, ts=PLACES).x * jnp.array([1.0, -2.0, 0.7]))


def exact_states(p):
    return jnp.sum(jax.vmap(lambda t: state(p, MANY, t))(PLACES) * jnp.array([1.0, -2.0, 0.7]))


ASKED = {"time": (time_of_switch, lambda p: switch(p, MANY)), "states": (later_states, exact_states)}
WAYS = {
    "over reverse": (lambda f: jax.jacfwd(jax.grad(f)), None),
    "over forward": (lambda f: jax.jacfwd(jax.jacfwd(f)), hs.ForwardSensitivities()),
}


FIRST = ("time", "over reverse")
LATER = [pytest.param(*slow, marks=pytest.mark.slow) for slow in itertools.product(ASKED, WAYS) if slow != FIRST]


@pytest.mark.parametrize("asked, way", [FIRST, *LATER])
def test_a_hessian_is_right_after_many_switches(asked, way):
    """The steps of a segment move with the event that it begins with. Where they stood still, the first of them would
    be shortened by as much as that event moves: after 60 switches the Hessian of a time was off by 2e-5, and that of
    states by 1e-7."""
    (found, exact), (twice, adjoint) = ASKED[asked], WAYS[way]
    hessian = jax.jit(twice(lambda p: found(p, 1e-8, adjoint)))(P)
    assert_close(hessian, jax.hessian(exact)(P), 5e-8)
