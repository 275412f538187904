"""One method for forward mode, reverse mode, and what is made of both: every derivative is that of the others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

ANY = hs.AnyMode()
APART = 1e-7
"""Forward and reverse mode cut their steps each by its own error: here they differ by 1.4e-9, second derivatives by
4e-8."""
P = jnp.array([9.81, 0.8, 1.0, 0.0, 1.5])
"""Weight, restitution, height, start and end."""


class Ball(hs.AbstractScene):
    weight: jax.Array
    e: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None] * (1 + 0.1 * jnp.sin(t))

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e[None]


def observed(p, adjoint=ANY):
    """The end, samples and event times of a motion with two impacts."""
    motion = hs.simulate(
        Ball(p[0], p[1]), hs.State(p[2:3], jnp.zeros(1)), t0=p[3], t1=p[4], ts=jnp.linspace(0.2, 1.4, 4),
        max_events=8, max_steps=256, adjoint=adjoint,
    )  # fmt: skip
    return jnp.concatenate([motion.final.q, motion.q[:, 0], motion.events.time[:2]])


def cost(p, adjoint=ANY):
    return jnp.sum(observed(p, adjoint) ** 2)


@pytest.fixture(scope="module")
def jacobian():
    return jax.jacrev(observed)(P, hs.Replay())


@pytest.mark.slow
def test_both_modes_are_those_of_the_methods_of_one(jacobian):
    np.testing.assert_array_equal(jax.jacrev(observed)(P), jacobian)
    forward = jax.jacfwd(observed)(P, hs.ForwardSensitivities())
    np.testing.assert_allclose(jax.jacfwd(observed)(P), forward, rtol=1e-14, atol=1e-15)  # compiled apart: rounding


@pytest.mark.slow
def test_a_linear_map_and_its_transpose(jacobian):
    """J v and J^T w of one `jax.linearize`, as Gauss-Newton steps by products take them."""
    along = jax.linearize(observed, P)[1]
    v, w = jnp.arange(5.0), jnp.arange(1.0, 8.0)
    assert_close(along(v), jacobian @ v, APART)
    assert_close(jax.linear_transpose(along, P)(w)[0], jacobian.T @ w, 1e-12)


@pytest.mark.slow
def test_batches_in_any_order(jacobian):
    """Of motions and of what they share."""
    batch = jnp.stack([P, P * jnp.array([1.01, 1.0, 1.0, 1.0, 1.0])])
    each = jnp.stack([jax.grad(cost)(p, hs.Replay()) for p in batch])
    of_all = lambda batch: jnp.sum(jax.vmap(cost)(batch))
    assert_close(jax.vmap(jax.grad(cost))(batch), each, 1e-13)
    assert_close(jax.jit(jax.grad(of_all))(batch), each, 1e-13)
    shared = lambda factor: of_all(batch.at[:, 0].multiply(factor))
    assert_close(jax.grad(shared)(1.0), jnp.sum(each[:, 0] * batch[:, 0]), 1e-13)
    assert_close(jax.jacfwd(jax.vmap(observed))(batch)[0, :, 0], jacobian, APART)


@pytest.mark.slow
def test_second_derivatives():
    """Forward over reverse and over forward."""
    hessian = jax.hessian(cost)(P, hs.Replay())
    assert_close(jax.hessian(cost)(P), hessian, 1e-13)
    assert_close(jax.jacfwd(jax.jacfwd(cost))(P), hessian, APART)


@pytest.mark.slow
def test_reverse_mode_over_another_is_refused():
    """By the name of what serves."""
    along = lambda p: jax.jvp(cost, (p,), (P,))[1]
    for refused in (jax.jacrev(jax.grad(cost)), jax.grad(along)):
        with pytest.raises(TypeError, match=r"use jax.jacfwd\(jax.grad.*or jax.hessian, or jax.jacfwd\(jax.jacfwd"):
            refused(P)


@pytest.mark.slow
def test_of_a_hybrid_system():
    """A thermostat, and its parameters by both modes."""
    system = hs.systems.Thermostat()

    def end(system):
        return hs.solve(system, system.initial_state(), system.initial_mode(), t1=3.0, adjoint=ANY).final

    reverse, forward = jax.jacrev(end)(system), jax.jacfwd(end)(system)
    for one, other in zip(jax.tree.leaves(reverse), jax.tree.leaves(forward), strict=True):
        assert_close(one, other, 1e-6)
