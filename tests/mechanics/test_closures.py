"""Traced values that a user's functions close over get their right gradient, never a silent zero."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close

P = jnp.array([1.3, 2.0, 0.4, 0.7, 1.5])
"""Mass, stiffness, distance, restitution, and the weight of the running cost."""


class Stop(hs.AbstractScene):
    """An oscillator that starts moving towards a stop, made from functions of anything."""

    sustained_contact = False
    p: jax.Array

    def mass_matrix(self, q):
        return self.p[0] * jnp.eye(1)

    def force(self, t, q, v):
        return -self.p[1] * q

    def gap(self, t, q):
        return self.p[2] - q

    def restitution(self):
        return self.p[3:4]


def cost(scene, running_cost, adjoint):
    start = hs.State(jnp.zeros(1), jnp.ones(1))
    settings = dict(t1=3.0, rtol=1e-9, atol=1e-9, max_events=4, max_steps=500)
    return hs.simulate(scene, start, running_cost=running_cost, adjoint=adjoint, **settings).cost


def from_leaves(p, adjoint):
    class Weighted(Stop):
        weight: jax.Array

    return cost(Weighted(p[:4], p[4]), lambda scene, t, q, v: scene.weight * q[0] ** 2, adjoint)


def from_closures(p, adjoint):
    class Hidden(hs.AbstractScene):
        sustained_contact = False

        def mass_matrix(self, q):
            return p[0] * jnp.eye(1)

        def force(self, t, q, v):
            return -p[1] * q

        def gap(self, t, q):
            return p[2] - q

        def restitution(self):
            return p[3:4]

    return cost(Hidden(), lambda scene, t, q, v: p[4] * q[0] ** 2, adjoint)


def from_a_closed_over_cost(p, adjoint):
    return cost(Stop(p[:4]), lambda scene, t, q, v: p[4] * q[0] ** 2, adjoint)


@pytest.fixture(scope="module")
def expected():
    return jax.jit(jax.grad(lambda p: from_leaves(p, hs.Replay())))(P)


@pytest.mark.parametrize("way", ["reverse", pytest.param("forward", marks=pytest.mark.slow)])
@pytest.mark.parametrize("function", [from_closures, pytest.param(from_a_closed_over_cost, marks=pytest.mark.slow)])
def test_closed_over_values_are_differentiated(function, way, expected):
    """Mass matrix, force, gap, restitution and running cost made from a traced value, in reverse and forward mode."""
    adjoint, derivative = (hs.Replay(), jax.grad) if way == "reverse" else (hs.ForwardSensitivities(), jax.jacfwd)
    assert jnp.all(expected != 0)
    # Either mode cuts steps for itself.
    assert_close(jax.jit(derivative(lambda p: function(p, adjoint)))(P), expected, 5e-9)
