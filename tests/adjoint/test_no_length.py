"""Second derivatives where a segment has no length: two events at one instant, or one at an end of the horizon.

Against closed forms whose second derivatives exist there, forward over reverse and forward over forward."""

import jax
import jax.numpy as jnp
import pytest
from jax import Array

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.hybrid_systems import Dosed

WAYS = ["over reverse", pytest.param("over forward", marks=pytest.mark.slow)]


def hessian(cost, way):
    """That of cost(p, adjoint)."""
    if way == "over reverse":
        return jax.jacfwd(jax.grad(lambda p: cost(p, hs.Replay())))
    return jax.jacfwd(jax.jacfwd(lambda p: cost(p, hs.ForwardSensitivities())))


class Leaks(hs.AbstractHybridSystem):
    """Neurons that do not know each other: x' = I - x, back to 0 at x = 1."""

    current: Array

    def flow(self, t, x, mode):
        return self.current - x

    def guards(self, t, x, mode):
        return 1 - x

    def transition(self, event, t, x, mode):
        return x.at[event].set(0.0), mode


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_neurons_that_fire_at_one_instant_have_second_derivatives_of_their_own(way):
    """x(T) = I (1 - exp(-(T - t_1))) with t_1 = log(I / (I - 1))."""

    def cost(p, adjoint):
        return jnp.sum(hs.solve(Leaks(p), jnp.zeros(2), t1=1.5, max_events=8, adjoint=adjoint).final)

    alone = lambda current: current - current * jnp.exp(-1.5) * current / (current - 1)
    p = jnp.array([1.5, 1.5])
    assert_close(hessian(cost, way)(p), jnp.diag(jax.vmap(jax.hessian(alone))(p)), 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("time", [0.0, 2.0], ids=["at the start", "at the end"])
def test_a_dose_at_an_end_of_the_horizon_has_the_second_derivatives_of_one_inside(time, way):
    """x(t) = x0 / (1 + k x0 t) on both sides of the dose; by k, its time, its size and x0."""

    def cost(p, adjoint):
        tight = dict(rtol=1e-11, atol=1e-11)
        return hs.solve(Dosed(*p[:3]), p[3], t1=2.0, max_events=4, adjoint=adjoint, **tight).final

    def exact(p):
        k, time, dose, x0 = p
        after = x0 / (1 + k * x0 * time) + dose
        return after / (1 + k * after * (2 - time))

    p = jnp.array([0.7, time, 0.9, 1.2])
    assert_close(hessian(cost, way)(p), jax.hessian(exact)(p), 1e-7)


class DraggedBall(hs.AbstractScene):
    """v' = -g - c v above a floor at q = 0."""

    gravity: Array
    sustained_contact = False

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.gravity - 0.5 * v

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.array([0.8])


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_a_ball_thrown_at_the_floor_from_the_floor(way):
    """Down from q0 = 0 with v0 < 0: the impact comes at t0. By g, q0 and v0, as from a height that comes to nothing.

    v(t) = (v0 + g / c) exp(-c t) - g / c, q(t) its integral; the impact's time by two of Newton's iterations, enough
    for two derivatives at a time that is 0."""

    def cost(p, adjoint):
        state = hs.State(p[1:2], p[2:])
        return hs.simulate(DraggedBall(p[:1]), state, t1=0.3, max_events=4, adjoint=adjoint).final.q[0]

    def moved(g, q, v, t):
        limit = -g / 0.5
        fades = jnp.exp(-0.5 * t)
        return q + limit * t + (v - limit) * (1 - fades) / 0.5, limit + (v - limit) * fades

    def exact(p):
        g, q0, v0 = p
        t = jnp.zeros(())
        for _ in range(2):
            q, v = moved(g, q0, v0, t)
            t = t - q / v
        q, v = moved(g, q0, v0, t)
        return moved(g, q, -0.8 * v, 0.3 - t)[0]

    p = jnp.array([9.81, 0.0, -3.0])
    assert_close(hessian(cost, way)(p), jax.hessian(exact)(p), 1e-7)


class Steady(Leaks):
    """The same with x' = 1, which depends on nothing: they fire at x = 1, and start again from I."""

    def flow(self, t, x, mode):
        return jnp.ones_like(x)

    def transition(self, event, t, x, mode):
        return x.at[event].set(self.current[event] ** 2), mode


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_a_flow_that_depends_on_nothing_has_derivatives_of_its_events_alone(way):
    """x(T) = T - 1 + I^2."""
    cost = lambda p, adjoint: jnp.sum(hs.solve(Steady(p), jnp.zeros(2), t1=1.5, max_events=4, adjoint=adjoint).final)
    assert_close(hessian(cost, way)(jnp.array([0.1, 0.1])), 2 * jnp.eye(2), 1e-12)
