"""Comparisons of what an event stops on the very number that it is compared with."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array

import hybridsens as hs

HORIZON, WEIGHT = 3.0, 9.81


class Pushed(hs.AbstractScene):
    """A ball that falls from 1, and a body that is pushed while the ball comes down."""

    located_discontinuities = True
    e: Array

    def mass_matrix(self, q):
        return jnp.diag(jnp.array([3.0, 1.0]))

    def force(self, t, q, v):
        return jnp.stack([jnp.array(-3 * WEIGHT), jnp.where(v[0] < 0, 1.0, 0.0)])

    def gap(self, t, q):
        return 0.7 * q[:1]

    def restitution(self):
        return self.e[None]


def pushed(e):
    """Where the body is at the end: flight k of the ball takes 2 e^k tf, and pushes in its second half."""
    half = jnp.sqrt(2 / WEIGHT) * e ** jnp.arange(60)
    ends = 2 * jnp.cumsum(half) - half[0]
    return jnp.sum(half**2 / 2 + half * (HORIZON - ends))


@jax.jit
def moved(e):
    def place(e):
        motion = hs.simulate(Pushed(e), hs.State([1.0, 0.0], [0.0, 0.0]), t1=HORIZON)
        return motion.final.q[1], motion

    return jax.value_and_grad(place, has_aux=True)(e)


@pytest.mark.parametrize(("e", "within"), [(0.0, 1e-8), (0.3, 1e-5)])
def test_a_ball_that_lands_and_rests_comes_down_no_more(e, within):
    """By an impact without rebound, and at the end of a cascade. The push went on for ever: 4.5 for 1.25.

    A cascade is cut where it rebounds at 6e-6 of its first speed, and the push ends with it."""
    (place, motion), by_e = moved(jnp.array(e))
    expected, slope = jax.jvp(pushed, (e,), (1.0,))
    np.testing.assert_allclose(place, expected, rtol=within)
    assert bool(motion.mode[0]) and motion.final.v[0] == pytest.approx(0, abs=1e-12)
    if e > 0:  # at 0 the flights that appear have no length
        np.testing.assert_allclose(by_e, slope, rtol=100 * within)


class Latched(hs.AbstractSwitchedScene):
    """A body whose velocity a latch sets at q = 1, and one that is driven by what a function says of that velocity."""

    located_discontinuities = True
    speed: Array
    """That the latch leaves."""
    drive: str

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v, mode):
        drives = {"positive": jnp.where(v[0] > 0, 1.0, 0.0), "sign": jnp.sign(v[0]), "whole": jnp.floor(v[0])}
        return jnp.stack([jnp.zeros(()), drives[self.drive]])

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)

    def switches(self, t, q, v, mode):
        return jnp.where(mode, 1.0, 1.0 - q[0])[None]

    def switch(self, event, t, q, v, mode):
        return v.at[0].set(self.speed), True


@pytest.mark.parametrize(
    ("drive", "before", "speed", "pushes"),
    [("positive", 1.0, 0.0, (1, 0)), ("sign", 0.8, 0.0, (1, 0)), ("whole", 1.5, 2.0, (1, 2))],
)
def test_a_latch_that_stops_a_body_changes_what_is_compared(drive, before, speed, pushes):
    """The velocity of the other body is what it was pushed by before and after 1 / v0."""
    start = hs.State([0.0, 0.0], [before, 0.0])
    motion = hs.simulate(Latched(jnp.array(speed), drive), start, False, t1=2.0)
    assert motion.status == hs.Status.successful
    np.testing.assert_allclose(motion.final.v[1], pushes[0] / before + pushes[1] * (2 - 1 / before), rtol=1e-9)


class Still(hs.AbstractHybridSystem):
    """A number that a transition stops at 0, and another one that goes by its sign."""

    located_discontinuities = True
    rate: Array

    def flow(self, t, x, mode):
        return jnp.stack([jnp.where(mode, 0.0, -self.rate), jnp.sign(x[0])])

    def guards(self, t, x, mode):
        return jnp.where(mode, 1.0, x[0] - 0.5)[None]

    def transition(self, event, t, x, mode):
        return x.at[0].set(0.0), jnp.array(True)


def test_the_sign_of_what_rests_at_0_is_0():
    """x' = sign of 1 - rate t until that is 1/2, and then 0: it was -1."""
    cost = lambda rate: hs.solve(Still(rate), jnp.array([1.0, 0.0]), jnp.array(False), t1=2.0).final[1]
    np.testing.assert_allclose(jax.value_and_grad(cost)(jnp.array(0.4)), [0.5 / 0.4, -0.5 / 0.4**2], rtol=1e-8)
    still = lambda x: hs.solve(Still(jnp.array(1.0)), jnp.array([x, 0.0]), jnp.array(True), t1=1.0).final[1]
    assert [float(still(x)) for x in (0.0, 1e-3, -1e-3)] == [0.0, 1.0, -1.0]
