"""A start that does not fit is told of by the one that the model has itself."""

import jax
import jax.numpy as jnp
import pytest
from jax import Array

import hybridsens as hs
from hybridsens.comparison.functional import move, ready_made_motion
from hybridsens.scenes import ShippedScene


class Decay(hs.AbstractHybridSystem):
    def initial_state(self):
        return {"x": 1.0, "y": jnp.ones(3)}

    def flow(self, t, x, mode):
        return {"x": -x["x"], "y": -x["y"]}

    def guards(self, t, x, mode):
        return x["x"][None]

    def transition(self, event, t, x, mode):
        return x, mode


class Braked(ShippedScene, hs.AbstractSwitchedScene):
    """It stops, and stays there: q = t - t^2 up to 1/2."""

    t1 = 1.0
    brake: Array

    def initial_state(self):
        return hs.State([0.0], [1.0])

    def initial_mode(self):
        return 1 if self.brake > 0 else 0

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v, mode):
        return -self.brake[None] * mode

    def gap(self, t, q):
        return q + 9

    def restitution(self):
        return jnp.ones(1)

    def switches(self, t, q, v, mode):
        return jnp.where(mode == 1, v, 1.0)

    def switch(self, event, t, q, v, mode):
        return v, 0 * mode


BRAKED = Braked(jnp.array(2.0))


@pytest.mark.parametrize("x0", [[1.0, 2.0], hs.State([1.0], [0.0]), 3.0])
def test_a_state_of_another_structure_is_told_with_the_right_one(x0):
    """It was Python that did not know how to take "x" from it."""
    with pytest.raises(TypeError, match=r"which is \{'x': \*, 'y': \*\} with a number .* but is"):
        hs.solve(Decay(), x0, t1=1.0)


class Fading(Decay):
    """A decay that is slower in a mode of its own."""

    def initial_mode(self):
        return {"slow": False}

    def flow(self, t, x, mode):
        return jax.tree.map(lambda leaf: jnp.where(mode["slow"], -leaf / 2, -leaf), x)


def test_a_mode_of_another_structure_is_told_with_the_right_one():
    with pytest.raises(TypeError, match=r"`mode` must be built as `system.initial_mode\(\)`, which is \{'slow': \*\}"):
        hs.solve(Fading(), Decay().initial_state(), {"fast": False}, t1=1.0)


def test_an_error_of_the_flow_itself_is_raised_as_it_is():
    class Misspelt(Decay):
        def flow(self, t, x, mode):
            return {"x": -x["z"], "y": x["y"]}

    with pytest.raises(KeyError, match="z"):
        hs.solve(Misspelt(), Decay().initial_state(), t1=1.0)


def test_a_mode_that_was_forgotten_is_asked_for():
    """It was a product with None."""
    with pytest.raises(TypeError, match=r"Thermostat has modes: it may be `system.initial_mode\(\)`"):
        hs.solve(hs.systems.Thermostat(), 20.0, t1=1.0)
    with pytest.raises(TypeError, match=r"Braked has modes: it may be `scene.initial_mode\(\)`"):
        hs.simulate(BRAKED, BRAKED.initial_state(), t1=1.0)


@pytest.mark.slow
def test_a_running_cost_may_leave_the_mode_out():
    """As that of every ready-made scene does: |q|^2."""
    found = ready_made_motion(BRAKED, move).cost
    assert found == pytest.approx(1 / 24 - 1 / 32 + 1 / 160 + 1 / 32, rel=1e-7)
