"""The two plain methods that the adjoint is shown beside: naive autodiff, and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.baselines import penalty_contact, where_reset, where_transition
from hybridsens.comparison.differentiate import finite_differences
from hybridsens.scenes import BouncingBall, PendulumWall
from hybridsens.systems import Dosing, RimlessWheel, TwoTanks
from tests.problems.hybrid_systems import Decay

T1 = 1.0


def _final_height(floor, steps: int):
    ball = BouncingBall(floor=floor)
    return where_reset(ball, ball.initial_state(), t1=T1, steps=steps).final.q[0]


def _exact_height(floor, height=1.0, g=9.81, e=0.8):
    """After one impact, at t_1 = sqrt(2 (height - floor) / g)."""
    fall = jnp.sqrt(2 * (height - floor) / g)
    return floor + e * g * fall * (T1 - fall) - g * (T1 - fall) ** 2 / 2


def test_the_naive_value_converges_and_its_gradient_does_not():
    """With 10 times the steps the value gets near the closed form, and the gradient by the floor's height stays 0."""
    value_and_grad = jax.value_and_grad(_final_height)
    exact, slope = jax.value_and_grad(_exact_height)(0.0)
    coarse, fine = (value_and_grad(jnp.array(0.0), steps) for steps in (1000, 10_000))
    assert abs(fine[0] - exact) < 2e-3 < abs(coarse[0] - exact) < 2e-2
    assert fine[1] == coarse[1] == 0
    assert abs(slope) > 0.3


def test_naive_running_cost_is_the_integral():
    """The running cost of a ball in free flight, q, integrates to the closed form at first order in the step."""
    ball = BouncingBall()
    motion = where_reset(ball, ball.initial_state(), t1=0.4, steps=4000, running_cost=lambda s, t, q, v: {"q": q[0]})
    np.testing.assert_allclose(motion.cost["q"], 0.4 - 9.81 * 0.4**3 / 6, rtol=1e-3)


def test_differences_are_of_fourth_order_and_know_where_they_are_one_sided():
    """The slopes of sin inside its domain, and of x^3 at either end of one, are met to rounding over width."""
    function = lambda theta: np.sin(theta[0]) + np.where(theta[1] > 1, np.nan, theta[1] ** 3)
    slopes, one_sided = finite_differences(function, np.array([0.7, 1.0]))
    np.testing.assert_allclose(slopes, [np.cos(0.7), 3.0], rtol=1e-10)
    assert one_sided.tolist() == [False, True]
    mirrored, _ = finite_differences(lambda theta: function(np.array([0.0, -theta[0]])), np.array([-1.0]))
    np.testing.assert_allclose(mirrored, [-3.0], rtol=1e-10)


def test_differences_do_not_hide_a_function_without_values():
    """Where no side has values, the result is nan and not a number that looks right."""
    slopes, _ = finite_differences(lambda theta: np.nan, np.ones(1))
    assert np.isnan(slopes).all()


def test_fixed_steps_of_a_system_say_that_they_keep_no_events():
    """So the row of a comparison has a sentence in it, and no name of a class."""
    motion = where_transition(Decay(), jnp.array(1.0), t1=1.0, steps=4)
    with pytest.raises(NotImplementedError, match="does not know its events"):
        _ = motion.events


@pytest.mark.parametrize("e", [0.9, 0.5, 0.1])
def test_a_penalty_contact_rebounds_with_the_restitution_of_the_scene(e):
    """At 1 m/s, without a load, in 250 steps of a contact; a push that is cut at 0 gives 0.55 for e = 0.5."""
    ball = BouncingBall(restitution_coefficient=e, weight=0.0)
    start = hs.State([0.5], [-1.0])
    end = jax.jit(lambda: penalty_contact(ball, start, t1=1.0, steps=25_000, contact_time=0.01).final.v[0])()
    assert end == pytest.approx(e, rel=0.02)


@pytest.mark.slow
def test_a_penalty_contact_is_damped_as_it_must_be_where_it_strikes():
    """A pendulum far from its wall begins where the wall has a third of its mobility: J within 2 % all the same."""
    pendulum = PendulumWall()
    asked = dict(t1=1.5, running_cost=lambda scene, t, q, v: q @ q)
    springs = dict(contact_time=4e-4, steps=40_000)
    soft = jax.jit(lambda: penalty_contact(pendulum, pendulum.initial_state(), **springs, **asked).cost)()
    hard = hs.simulate(pendulum, pendulum.initial_state(), max_events=8, max_steps=512, **asked).cost
    np.testing.assert_allclose(soft, hard, rtol=0.02)


@pytest.mark.slow
def test_fixed_steps_of_a_system_give_the_dose_that_comes_at_the_start():
    """All that is left in gut and blood after one dose at t0 and one at 8 h, within 1 % of the motion itself."""
    dosing = Dosing(times=[0.0, 8.0, -1.0])
    start = dosing.initial_state(), dosing.initial_mode()
    naive = where_transition(dosing, *start, t1=12.0, steps=4000).final
    exact = hs.solve(dosing, *start, t1=12.0, max_events=4).final
    np.testing.assert_allclose(naive["blood"], exact["blood"], rtol=1e-2)


@pytest.mark.parametrize("kind", [pytest.param(RimlessWheel, marks=pytest.mark.slow), TwoTanks])
def test_a_transition_that_puts_another_guard_at_0_is_no_second_event(kind):
    """Where the next spoke strikes, the wheel stands at the angle at which the one uphill would: J within 1 %."""
    system = kind()
    start = system.initial_state(), system.initial_mode()
    J = lambda move, **settings: move(system, *start, t1=kind.t1, running_cost=kind.running_cost, **settings).cost
    naive = jax.jit(lambda: J(where_transition, steps=20_000))()
    np.testing.assert_allclose(naive, J(hs.solve, max_events=32, max_steps=512), rtol=1e-2)
