"""A motion is computed in the type of its state, whatever the types of a scene's leaves and of what it returns."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close

SETTINGS = dict(t1=1.0, rtol=1e-6, atol=1e-6, max_events=4, max_steps=200)
"""A ball that is dropped from 1 bounces once until then."""


class Ball(hs.AbstractScene):
    """A ball that never rests; p = (weight, e)."""

    sustained_contact = False
    p: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1, dtype=q.dtype)

    def force(self, t, q, v):
        return -self.p[:1]

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.p[1:]


def final(scene, dtype, **settings):
    start = hs.State(jnp.ones(1, dtype), jnp.zeros(1, dtype))
    return hs.simulate(scene, start, **(SETTINGS | settings)).final.q[0]


P = jnp.array([9.75, 0.75])  # exact in every type


@pytest.fixture(scope="module")
def expected():
    return jax.grad(lambda p: final(Ball(p), jnp.float64))(P)


@pytest.mark.parametrize("leaf", ["float32", "bfloat16"])
def test_the_gradient_comes_in_the_type_of_the_leaf(leaf, expected):
    """Leaves that are coarser than the state: the motion is computed in the state's type."""
    value, gradient = jax.value_and_grad(lambda p: final(Ball(p), jnp.float64))(P.astype(leaf))
    assert value.dtype == jnp.float64 and gradient.dtype == leaf
    assert_close(gradient.astype(float), expected, 2 * float(jnp.finfo(leaf).eps))


@pytest.mark.slow
def test_forward_mode_takes_leaves_of_another_type(expected):
    """The tangents come in the type of the state."""
    motion = lambda p: final(Ball(p), jnp.float64, adjoint=hs.ForwardSensitivities())
    jacobian = jax.jacfwd(motion)(P.astype("float32"))
    assert_close(jacobian, expected, 1e-12)


def test_a_float32_state_makes_a_float32_motion(expected):
    """Leaves finer than the state, and functions that return a finer type (`jnp.eye` does)."""

    class Finer(Ball):
        def mass_matrix(self, q):
            return jnp.eye(1)

        def gap(self, t, q):
            return q + jnp.zeros(1)

        def restitution(self):
            return super().restitution().astype("float64")

    value, gradient = jax.value_and_grad(lambda p: final(Finer(p), jnp.float32, rtol=1e-5, atol=1e-5))(P)
    assert value.dtype == jnp.float32 and gradient.dtype == jnp.float64
    assert_close(gradient, expected, 1e-4)


def test_what_a_scene_closes_over_may_have_another_type(expected):
    """Hidden traced values are cast as leaves are; the running cost is given the scene as it was written."""

    def cost(p):
        class Hidden(Ball):
            def force(self, t, q, v):
                return -p[:1]

            def restitution(self):
                return p[1:]

        start = hs.State(jnp.ones(1), jnp.zeros(1))
        speed = lambda scene, t, q, v: v[0] * scene.p[0]
        return hs.simulate(Hidden(jnp.ones(1)), start, running_cost=speed, **SETTINGS).cost

    gradient = jax.grad(cost)(P.astype("float32"))
    assert gradient.dtype == jnp.float32
    assert_close(gradient.astype(float), expected, 1e-6)


def test_a_gap_coarser_than_the_state_is_refused():
    """Its rounding is what events are told by."""

    class Coarse(Ball):
        def gap(self, t, q):
            return q.astype("float32")

    with pytest.raises(TypeError, match="`gap` must return float64, the type of the state, but returns float32"):
        final(Coarse(P), jnp.float64)
