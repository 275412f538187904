"""A system and a gradient method of one's own, from the public names alone, against a closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems.hybrid_systems import Thermostat

GIVEN = (0.3, 10.0, 6.0, 18.0, 22.0)
END = 3.0


class PlainReplay(hs.AbstractGradientMethod):
    """The derivative of the motion's own step, times `factor`; without any control of its error."""

    factor: float = 1.0

    def carry_back(self, step: hs.RecordedStep, psi) -> hs.StepBack:
        pull = jax.vjp(lambda p, x: step.advance(p, x, step.t1), step.parameters, step.x0)[1]
        total, psi0 = pull(self.factor * psi)
        return hs.StepBack(total, psi0)


class Midpoint(hs.AbstractGradientMethod):
    """psi' = -f_x^T psi by one step of the midpoint rule: right to the second order of the recorded steps."""

    def carry_back(self, step: hs.RecordedStep, psi) -> hs.StepBack:
        h, middle = step.t1 - step.t0, (step.t0 + step.t1) / 2
        x = step.advance(step.parameters, step.x0, middle)
        pull = jax.vjp(lambda p, x: step.flow(p, middle, x), step.parameters, x)[1]
        half = psi + h / 2 * pull(psi)[1]
        total, rise = pull(half)
        scaled = jax.tree.map(lambda leaf: h * leaf, total)
        return hs.StepBack(scaled, psi + h * rise)


def final_temperature(a, outside, heat, low, high):
    """From 20 it cools to `low`, is heated to `high`, and cools again: exponentials."""
    first = jnp.log((20.0 - outside) / (low - outside)) / a
    top = outside + heat / a
    second = first + jnp.log((top - low) / (top - high)) / a
    return outside + (high - outside) * jnp.exp(-a * (END - second))


def gradient_by(method, **settings):
    """d x(END) / d (all parameters)."""

    def final(numbers):
        start = {"inside": 20.0}, {"on": False, "count": 0}
        motion = hs.solve(Thermostat(*numbers), *start, t1=END, adjoint=method, max_events=4, **settings)
        return motion.final["inside"], motion.events.count

    return jax.grad(final, has_aux=True)(tuple(jnp.array(number) for number in GIVEN))


def truth():
    return np.array(jax.grad(lambda numbers: final_temperature(*numbers))(tuple(map(jnp.array, GIVEN))))


def test_a_gradient_method_of_ones_own_is_one_function():
    """Its steps are differentiated as it says, and the events between them as the package does."""
    gradient, events = gradient_by(PlainReplay())
    assert events == 2
    assert_close(np.array(gradient), truth(), 1e-6)
    doubled, _ = gradient_by(PlainReplay(factor=1.001))
    assert np.max(np.abs(np.array(doubled) - truth())) > 1e-4 * np.max(np.abs(truth()))


@pytest.mark.slow
def test_a_method_that_approximates_is_as_good_as_its_steps():
    """The midpoint rule on steps of 1/20: an error of their square; the same method serves a scene."""
    coarse, fine = (gradient_by(Midpoint(), max_step=step)[0] for step in (0.1, 0.05))
    errors = [np.max(np.abs(np.array(gradient) - truth())) for gradient in (coarse, fine)]
    assert errors[1] < 1e-3 * np.max(np.abs(truth())) and 3 < errors[0] / errors[1] < 5
    ball = hs.scenes.BouncingBall(height=1.0, restitution_coefficient=0.8)
    drop = lambda ball, method: hs.simulate(ball, ball.initial_state(), t1=0.8, adjoint=method).final.q[0]
    slopes = [jax.grad(drop)(ball, method).height for method in (PlainReplay(), hs.Replay())]
    assert_close(slopes[0], slopes[1], 1e-12)


def test_a_method_that_carries_nothing_back_cannot_be_made():
    """The interface says what is missing."""

    class Empty(hs.AbstractGradientMethod):
        pass

    with pytest.raises(TypeError, match="carry_back"):
        Empty()  # type: ignore[abstract]
