"""`check_gradient` names a function that has no finite derivative where the motion comes, and the time."""

import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.comparison.check_finite import without_derivative
from hybridsens.comparison.check_motions import value_with_calls
from hybridsens.parameters import flatten_parameters
from hybridsens.scenes import BouncingBall
from hybridsens.scenes.shipped import parameter


class Dragged(BouncingBall):
    """Quadratic drag from rest. JAX's derivative of a norm at 0 is nan."""

    drag: jnp.ndarray = parameter(0.1)

    def speed(self, v):
        return jnp.linalg.norm(v)

    def force(self, t, q, v):
        return super().force(t, q, v) - self.drag * self.speed(v) * v


class DraggedSmoothly(Dragged):
    def speed(self, v):
        return jnp.sqrt(v @ v + 1e-30)


class Shuttle(hs.AbstractSwitchedScene):
    """A cart that starts at rest under quadratic drag, and is driven back beyond 0.3."""

    drag: jnp.ndarray = parameter(0.1)

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return jnp.where(mode, 1.0, -1.0)[None] - self.drag * jnp.linalg.norm(v) * v

    def gap(self, t, q):
        return q + 1

    def restitution(self):
        return jnp.array([0.5])

    def switches(self, t, q, v, mode):
        return jnp.where(mode, 0.3 - q, q + 0.3)

    def switch(self, event, t, q, v, mode):
        return v, ~mode


class Halved(hs.AbstractHybridSystem):
    """A point that runs down to 1, and is set to 0 there, where its flow has no derivative afterwards."""

    rate: jnp.ndarray = parameter(1.0)

    def flow(self, t, x, mode):
        return jnp.where(mode, jnp.linalg.norm(x) * x, -self.rate * jnp.ones(1))

    def guards(self, t, x, mode):
        return jnp.where(mode, 1.0, x - 1)

    def transition(self, event, t, x, mode):
        return 0 * x, ~mode


def fall(scene, simulate):
    return simulate(scene, hs.State([1.0], [0.0]), t1=0.6).final.q[0]


def drive(scene, simulate):
    return simulate(scene, hs.State([0.0], [0.0]), jnp.array(False), t1=2.0).final.q[0]


def run_down(system, solve):
    return solve(system, jnp.array([2.0]), jnp.array(False), t1=1.5).final[0]


@pytest.mark.parametrize(
    ("model", "cost", "places"),
    [
        (Dragged(), fall, [("force", 0.0)]),
        pytest.param(DraggedSmoothly(), fall, [], marks=pytest.mark.slow),
        pytest.param(Shuttle(), drive, [("force", 0.0)], marks=pytest.mark.slow),
        (Halved(), run_down, [("flow", pytest.approx(1.0))]),
    ],
    ids=["scene", "smooth", "switched scene", "system"],
)
def test_a_function_without_a_derivative_is_found(model, cost, places):
    parameters = flatten_parameters(model)
    _, calls = value_with_calls(parameters, cost, dict(max_events=8, max_steps=256))(parameters.vector)
    assert list(without_derivative(calls[0]).items()) == places


@pytest.mark.slow
def test_a_function_without_a_derivative_is_the_cause():
    check = hs.check_gradient(Dragged(), fall, max_events=8, max_steps=1024)
    assert [cause.kind for cause in check.causes] == ["no derivative"], str(check)
    assert "`force` at t = 0." in " ".join(str(check).split())
