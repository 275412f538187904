"""JAX mistakes one axis for another where a derivative rule puts a batch elsewhere than its function does; ours do
not."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.numerics.batch_axes import batch_in_front
from hybridsens.numerics.dense import solve_spd
from tests.closeness import assert_close


@jax.custom_jvp
def stacked(x):
    """Entries put together again: under `jax.vmap` the axis of the batch comes second."""
    return batch_in_front(jnp.stack([x[0], x[1], x[2]]))


@stacked.defjvp
def _stacked_jvp(primals, tangents):
    return batch_in_front(1.0 * primals[0]), 2.0 * tangents[0]


@pytest.mark.parametrize("compiled", [lambda f: jax.jit(jax.vmap(f)), lambda f: jax.vmap(jax.jit(f))])
def test_a_rule_of_its_own_is_not_transposed(compiled):
    x, dx = jax.random.normal(jax.random.key(0), (2, 3, 3))
    value, tangent = jax.jvp(compiled(stacked), (x,), (dx,))
    assert np.array_equal(value, x) and np.array_equal(tangent, 2 * dx)
    assert np.array_equal(jax.vjp(compiled(stacked), x)[1](dx)[0], 2 * dx)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_a_batch_of_solutions_goes_back_as_one_by_one(n):
    """As many right-hand sides as unknowns, so that nothing but the numbers tells of a wrong axis."""
    matrix = jnp.eye(n) + 0.1
    solve = jax.jit(lambda b: solve_spd(matrix, solve_spd(matrix, b) ** 2))
    b, cotangent = jax.random.normal(jax.random.key(0), (2, n, n))
    together = jax.vjp(jax.vmap(solve), b)[1](cotangent)[0]
    one_by_one = [jax.vjp(solve, row)[1](bar)[0] for row, bar in zip(b, cotangent, strict=True)]
    assert_close(together, jnp.stack(one_by_one), 1e-13)


class Springs(hs.AbstractScene):
    """q'' = -M^-1 q, with a mass matrix of any size that is not known to be diagonal."""

    mass: jax.Array

    def mass_matrix(self, q):
        return self.mass * (1 + 0.1 * jnp.cos(q[0]))

    def force(self, t, q, v):
        return -q

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)


@pytest.mark.slow
@pytest.mark.parametrize("dof, samples", [(3, 3), (5, 2), (3, 2), (5, 3)])
def test_a_sample_moves_along_the_motion_with_its_time(dof, samples):
    """d q(ts) / d ts = v, in reverse mode."""
    scene, start = Springs(jnp.eye(dof) + 0.2), hs.State(jnp.arange(1.0, dof + 1), jnp.zeros(dof))
    ts = jnp.linspace(0.2, 0.8, samples)

    def weighed(ts):
        motion = hs.simulate(scene, start, t1=1.0, ts=ts, max_events=1, max_steps=64)
        return jnp.sum(motion.q @ jnp.arange(1.0, dof + 1)), motion.v @ jnp.arange(1.0, dof + 1)

    gradient, velocity = jax.grad(weighed, has_aux=True)(ts)
    assert_close(gradient, velocity, 1e-7)
