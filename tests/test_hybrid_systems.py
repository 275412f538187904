"""The solver and its adjoint know no mechanics: two systems without any, against closed forms."""

import diffrax
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.differentiable import differentiable_motion
from hybridsens.flat_system import AbstractFlatSystem, Decision
from hybridsens.forward.solver import RunSettings
from hybridsens.passes import Options, Problem
from tests.closeness import assert_close
from tests.jacobians import value_and_jacobian

WITHIN = 1e-9


class Thermostat(AbstractFlatSystem):
    """x' = a (outside - x) + heat while the heater is on; it switches at `low` and `high`.

    The mode says whether the heater is on.
    """

    p: jax.Array

    def flow(self, t, x, mode):
        a, outside, heat, _, _ = self.p
        return a * (outside - x) + jnp.where(mode, heat, 0)

    def guards(self, t, x, mode):
        return jnp.where(mode, self.p[4] - x, x - self.p[3])

    def decide(self, event, t, x, mode):
        return Decision(jnp.where(event < 0, mode, ~mode), jnp.array(0))  # the start leaves it

    def reset(self, decision, t, x):
        return x, ()


class SwitchedOscillator(AbstractFlatSystem):
    """x'' = -w^2 x with w1 to the right of 0 and w2 to the left; crossing 0 multiplies the velocity by rho.

    The mode says whether x < 0. What a crossing emits is the energy that it takes.
    """

    p: jax.Array

    def flow(self, t, x, mode):
        w = jnp.where(mode, self.p[1], self.p[0])
        return jnp.stack([x[1], -(w**2) * x[0]])

    def guards(self, t, x, mode):
        return jnp.where(mode, -x[:1], x[:1])

    def decide(self, event, t, x, mode):
        return Decision(jnp.where(event < 0, mode, ~mode), jnp.array(0))  # the start leaves it

    def reset(self, decision, t, x):
        rho = self.p[2]
        return jnp.stack([x[0], rho * x[1]]), (1 - rho**2) * x[1] ** 2 / 2


def run(system, x0, mode, t1, adjoint):
    settings = RunSettings(diffrax.Tsit5(), 1e-12, 1e-12, 8, 2000)
    inputs = Problem(system, x0, jnp.array(0.0), jnp.asarray(t1), None, jnp.array(0.0))
    return differentiable_motion(inputs, Options(jnp.array(mode), hs.Status.running, settings), adjoint)


@pytest.mark.parametrize("adjoint", [hs.Replay(), hs.ForwardSensitivities()], ids=["reverse", "forward"])
def test_thermostat(adjoint):
    """Three switches in closed form: their times and the last temperature, by every parameter and the start."""

    def computed(p, adjoint):
        report = run(Thermostat(p[:5]), p[5:], False, 3.2, adjoint)
        return jnp.concatenate([report.observed.events.time[:3], report.observed.final])

    def exact(p):
        a, outside, heat, low, high, x0 = p
        hot = outside + heat / a
        t_on = jnp.log((x0 - outside) / (low - outside)) / a
        t_off = t_on + jnp.log((hot - low) / (hot - high)) / a
        t_on_again = t_off + jnp.log((high - outside) / (low - outside)) / a
        final = hot + (low - hot) * jnp.exp(-a * (3.2 - t_on_again))
        return jnp.stack([t_on, t_off, t_on_again, final])

    p = jnp.array([0.3, 10.0, 9.0, 18.0, 22.0, 20.0])
    value, derivative = jax.jit(value_and_jacobian(computed, adjoint))(p)
    assert_close(value, exact(p), WITHIN)
    assert_close(derivative, jax.jacfwd(exact)(p), WITHIN)


@pytest.mark.slow
@pytest.mark.parametrize("adjoint", [hs.Replay(), hs.ForwardSensitivities()], ids=["reverse", "forward"])
def test_switched_oscillator(adjoint):
    """Resets, a segment that starts on its own guard, and what the resets emit, by w1, w2, rho and the start."""

    def computed(p, adjoint):
        report = run(SwitchedOscillator(p[:3]), jnp.stack([p[3], 0 * p[3]]), False, 5.5, adjoint)
        final, _, events = report.observed
        return jnp.concatenate([events.time[:2], events.emitted[:2], events.before[1], events.after[1], final])

    def exact(p):
        w1, w2, rho, x0 = p
        times = jnp.stack([jnp.pi / (2 * w1), jnp.pi / (2 * w1) + jnp.pi / w2])
        speed = w1 * x0 * rho ** jnp.arange(3)
        emitted = (1 - rho**2) * speed[:2] ** 2 / 2
        phase = w1 * (5.5 - times[1])
        final = jnp.stack([speed[2] / w1 * jnp.sin(phase), speed[2] * jnp.cos(phase)])
        sides = jnp.stack([0.0 * x0, speed[1], 0.0 * x0, speed[2]])
        return jnp.concatenate([times, emitted, sides, final])

    p = jnp.array([1.0, 0.9, 0.8, 1.5])
    value, derivative = jax.jit(value_and_jacobian(computed, adjoint))(p)
    assert_close(value, exact(p), WITHIN)
    assert_close(derivative, jax.jacfwd(exact)(p), WITHIN)
