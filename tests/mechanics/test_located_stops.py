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


@pytest.mark.slow
@pytest.mark.parametrize(("e", "within"), [(0.0, 1e-8), (0.3, 1e-5)])
def test_a_ball_that_lands_and_rests_comes_down_no_more(e, within):
    """By an impact without rebound, and at the end of a cascade. The push went on for ever: 4.5 for 1.25.

    A cascade is cut where it rebounds at 6e-6 of its first speed, and the push ends with it."""
    (place, motion), by_e = moved(jnp.array(e))
    expected, slope = jax.jvp(pushed, (e,), (1.0,))
    np.testing.assert_allclose(place, expected, rtol=within)
    assert bool(motion.mode[0]) and motion.final.v[0] == pytest.approx(0, abs=1e-12)
    if e > 0:  # at 0 the flights that appear have no length; what is cut goes as the tenth power of e
        np.testing.assert_allclose(by_e, slope, rtol=30 * within)


class Latched(hs.AbstractSwitchedScene):
    """A body whose velocity a latch sets at q = 1, and three that are driven by what functions say of that velocity."""

    located_discontinuities = True
    speed: Array
    """That the latch leaves."""

    def mass_matrix(self, q):
        return jnp.eye(4)

    def force(self, t, q, v, mode):
        return jnp.stack([jnp.zeros(()), jnp.where(v[0] > 0, 1.0, 0.0), jnp.sign(v[0]), jnp.floor(v[0])])

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)

    def switches(self, t, q, v, mode):
        return jnp.where(mode, 1.0, 1.0 - q[0])[None]

    def switch(self, event, t, q, v, mode):
        return v.at[0].set(self.speed), True


@jax.jit
def latched(v0, speed):
    start = hs.State(jnp.zeros(4), jnp.zeros(4).at[0].set(v0))
    return hs.simulate(Latched(speed), start, False, t1=2.0)


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "drives"), [(0.0, [0, 0, 0]), (2.0, [1, 1, 2])], ids=["to a stop", "to 2"])
def test_a_latch_that_stops_a_body_changes_what_is_compared(speed, drives):
    """Each of the others is driven by 1 before 1 / v0; the velocity is between two whole numbers then."""
    motion = latched(jnp.array(1.5), jnp.array(speed))
    assert motion.status == hs.Status.successful
    np.testing.assert_allclose(motion.final.v[1:], 1 / 1.5 + np.array(drives) * (2 - 1 / 1.5), rtol=1e-9)


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


@jax.jit
@jax.value_and_grad
def gone(rate, x, stopped):
    return hs.solve(Still(rate), jnp.stack([x, 0.0]), stopped, t1=2.0).final[1]


@pytest.mark.slow
def test_the_sign_of_what_rests_at_0_is_0():
    """x' = sign of 1 - rate t until that is 1/2, and then 0: it was -1."""
    found = gone(jnp.array(0.4), jnp.array(1.0), jnp.array(False))
    np.testing.assert_allclose(found, [0.5 / 0.4, -0.5 / 0.4**2], rtol=1e-8)
    still = lambda x: gone(jnp.array(1.0), jnp.array(x), jnp.array(True))[0]
    assert [float(still(x)) for x in (0.0, 1e-3, -1e-3)] == [0.0, 2.0, -2.0]
