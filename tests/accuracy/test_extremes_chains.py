"""Long chains of impacts, chaos, stiffness, small gaps: short versions of what `benchmarks/extremes` prints."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems import elastic_ball, elastic_wall, impact_oscillator, small_gaps, stiff_support


@pytest.mark.slow
def test_two_thousand_impacts_keep_energy_time_and_gradient():
    """An elastic ball: no impact missed, energy to 2.5e-15 per impact, times to 1e-10, the gradient to 1e-6."""
    count = 2000
    horizon = (2 * count - 0.5) * np.sqrt(2 / elastic_ball.GRAVITY)
    height = elastic_ball.final_height_of(count, horizon)
    (_, motion), slope = jax.jit(jax.value_and_grad(height, has_aux=True))(jnp.array(1.0))
    errors = elastic_ball.chain_errors(motion, count)
    assert motion.status == hs.Status.successful
    assert errors["impacts missed or made up"] == 0
    assert errors["event times, relative"] <= 1e-10 and errors["energy drift, relative"] <= 5e-12
    assert_close(slope, elastic_ball.exact_slope(count, horizon), 1e-6)


@pytest.mark.slow
def test_ten_thousand_periods_keep_energy_phase_and_gradient():
    """An oscillator and an elastic wall by Dopri8: no impact missed; the phase is off by the square of the periods."""
    periods = 10_000
    final = elastic_wall.final_of(periods, diffrax.Dopri8(), 1e-13, hs.Replay(recompute=True))
    given = jnp.array(1.0), jnp.array(0.0), jnp.array(elastic_wall.end_of(periods))
    slope, (end, motion) = jax.jit(jax.grad(lambda *x: (lambda out: (out[0][0], out))(final(*x)), has_aux=True))(*given)
    errors = elastic_wall.errors(end, motion.events.count, periods)
    assert motion.status == hs.Status.successful and errors["impacts missed or made up"] == 0
    assert errors["energy drift, relative"] <= 1e-9 and errors["phase, of a period"] <= 1e-6
    assert_close(slope, jax.jacfwd(elastic_wall.exact)(given[0], periods, given[2])[0], 5e-6)


@pytest.mark.slow
def test_the_growth_of_variations_in_chaos_is_that_of_long_arithmetic():
    """Over 23 impacts variations grow 1e5 times; matrix, growth and exponent agree with 30 digits."""
    _, matrix, impacts = impact_oscillator.reference(0.5, 80.0, digits=30)
    found = impact_oscillator.grow(jnp.array(0.5), jnp.array(80.0), jnp.array(1e-12))
    assert found.trajectory.events.count == impacts
    growth = np.linalg.norm(matrix, 2)
    assert growth > 1e4
    assert_close(found.matrix, matrix, 1e-5)
    assert_close(found.growth, growth, 1e-5)
    assert_close(found.exponent, np.log(growth) / 80, 1e-6)


def test_lyapunov_takes_no_setting_that_it_makes_itself():
    """The method of differentiation is its own."""
    scene = impact_oscillator.ImpactOscillator(jnp.array(1.0), jnp.array(0.9))
    with pytest.raises(TypeError, match="adjoint"):
        hs.lyapunov(scene, None, t1=1.0, adjoint=hs.Replay())


@pytest.mark.slow
def test_an_implicit_solver_lands_beside_a_support_a_million_times_stiffer():
    """Value and gradient to the tolerance's order, against a matrix exponential in 40 digits."""
    value, gradient = stiff_support.reference(1e6)
    (found, motion), slope = stiff_support.solve(diffrax.Kvaerno5(), jnp.array(1e6), jnp.array(1e-6))
    assert motion.status == hs.Status.successful and motion.steps.accepted < 100
    assert_close(found, value, 2e-5, scale=1.0)
    assert_close(slope, gradient, 2e-5)


@pytest.mark.slow
def test_an_explicit_solver_says_that_it_crawls():
    """The status names the remedy."""
    (_, motion), _ = stiff_support.solve(diffrax.Tsit5(), jnp.array(1e4), jnp.array(1e-6))
    assert motion.status == hs.Status.max_steps_reached
    assert "implicit" in hs.Status[motion.status]


@pytest.mark.slow
@pytest.mark.parametrize("place, within", [(0.0, 1e-9), (1.0, 1e-3)])
def test_a_thousand_impacts_in_a_clearance_of_a_billionth(place, within):
    """None is missed, the slope by the speed is +-1, the place is right to rounding of the walls' own place."""
    speed = 1000.25 * small_gaps.CLEARANCE
    value, slope, motion = small_gaps.rattle(jnp.array(place), jnp.array(speed))
    assert motion.status == hs.Status.successful and motion.events.count == 1000
    assert_close(slope, 1.0, 1e-10)
    assert_close(value, 0.75 * small_gaps.CLEARANCE, within)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [1.0, 1e-2, 1e-4, 5e-7])
def test_a_bead_hits_a_tip_of_any_radius(radius):
    """A free flight crosses the whole of the tip's gap in one step, and must not pass through it."""
    motion, slope = small_gaps.strike(jnp.array(radius), jnp.array(0.6))
    assert motion.events.count == 1
    assert_close(motion.final.v, np.array([-0.28, 0.96]), 1e-9)
    assert_close(slope, np.array([2.4, 2 * 0.8 - 2 * 0.36 / 0.8]), 1e-9)


@pytest.mark.parametrize("width", [0.1, 1e-4, 1e-8])
def test_a_thin_spike_is_met(width):
    """In free flight at any width, with no help from `max_step`."""
    motion = small_gaps.fly(jnp.array(width), None)
    assert motion.status == hs.Status.successful and motion.events.count == 1
    assert_close(motion.final.q, np.array([2 * (0.6 - width * np.sqrt(np.log(2))) - 1]), 1e-12)


class Switched(hs.AbstractScene):
    """q'' = +1, from `when` on -1: a force with a jump in time that nobody declares."""

    when: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.where(t < self.when, 1.0, -1.0)[None]

    def gap(self, t, q):
        return q + 1

    def restitution(self):
        return jnp.full(1, 0.5)


def test_a_hidden_jump_of_the_force_costs_steps_not_accuracy():
    """The error control finds it: the value is right to a hundred tolerances (its slope is the user's to declare, as a
    warning says)."""
    state = hs.State(jnp.zeros(1), jnp.zeros(1))
    with pytest.warns(hs.DiscontinuityWarning, match="jnp.where of t"):
        motion = hs.simulate(Switched(jnp.array(0.7)), state, t1=2.0)
    assert_close(motion.final.q, np.array([0.245 + 0.7 * 1.3 - 0.845]), 2e-6, scale=1.0)
    assert motion.steps.rejected > 3


def test_an_event_that_appears_changes_the_count_and_the_cost_by_its_speed():
    """On both sides of grazing the count of events tells what the cost alone hides: J is continuous there."""

    def simulate(amplitude):
        scene = hs.scenes.ElasticStop(
            damping=0.0, amplitude=0.0, stiffness=1.0, distance=1.0, restitution_coefficient=0.5
        )
        state = hs.State(jnp.zeros(1), jnp.array([amplitude]))
        return hs.simulate(scene, state, t1=3.0, rtol=1e-10, atol=1e-10)

    missed, met = simulate(1.0 - 1e-6), simulate(1.0 + 1e-6)
    assert missed.events.count == 0 and met.events.count == 1
    speed = float(met.events.closing_speed[0])
    assert_close(met.final.q, missed.final.q, 2 * speed, scale=1.0)
