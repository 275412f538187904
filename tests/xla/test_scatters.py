"""Sums by scatters, as loops: the same sums, and a motion that is differentiated through one is one kernel."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.xla.rewriting import rewritten
from tests.closeness import assert_close
from tests.xla.test_one_kernel import entry_of

PLACES = np.array([2, 0, 2, 5, -1])  # twice the same, beyond the end, from the end

SUMS = {
    "entries": lambda x, u: x.at[PLACES].add(u[:, 0]),
    "entries beyond the end": lambda x, u: x.at[PLACES].add(u[:, 0], mode="clip"),
    "rows": lambda x, u: jnp.outer(x, x).at[PLACES].add(u),
    "columns": lambda x, u: jnp.outer(x, x).at[:, PLACES].add(u.T),
    "places that are computed": lambda x, u: x.at[(3 * jnp.abs(x)).astype(int)].add(u[0]),
    "in a loop": lambda x, u: jax.lax.scan(lambda x, u: (x.at[PLACES].add(u), None), x, u.T)[0],
    "in a batch": lambda x, u: jax.vmap(lambda u: x.at[PLACES].add(u))(u.T),
    "of a reading": lambda x, u: jax.vjp(lambda x: x[PLACES % 4] * u[:, 0], x)[1](u[:, 1])[0],
}


@pytest.mark.parametrize("name", SUMS)
def test_a_loop_adds_what_a_scatter_adds(name):
    x, u = jnp.array([0.1, 0.5, -0.9, 0.3]), jnp.sin(jnp.arange(20.0)).reshape(5, 4)
    looped = rewritten(SUMS[name])
    assert "scatter" in str(jax.make_jaxpr(SUMS[name])(x, u))
    assert "scatter" not in str(jax.make_jaxpr(looped)(x, u))
    assert_close(looped(x, u), SUMS[name](x, u), 1e-15)
    derivative = lambda f: jax.jacrev(f, argnums=(0, 1))(x, u)
    for found, right in zip(derivative(looped), derivative(SUMS[name]), strict=True):
        assert_close(found, right, 1e-15, scale=1.0)


def test_what_has_no_scatter_is_left_as_it_is():
    function = lambda x: jax.lax.scan(lambda x, _: (jnp.sin(x), None), x, length=3)[0]
    trace = lambda f: str(jax.make_jaxpr(f)(jnp.ones(3)))
    assert trace(rewritten(function)) == trace(function)


class Ring(hs.AbstractScene):
    """Masses on a ring of springs above a floor, with forces that are read and added up by indices."""

    stiffness: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(q.size)

    def force(self, t, q, v):
        one, other = np.arange(q.size), np.roll(np.arange(q.size), 1)
        pull = self.stiffness * (q[other] - q[one])
        return jnp.zeros_like(q).at[one].add(pull).at[other].add(-pull) - 1.0

    def gap(self, t, q):
        return q

    def restitution(self):
        return jnp.full(3, 0.5)


@pytest.mark.slow
def test_a_force_by_indices_leaves_a_motion_and_its_gradient_one_kernel_each():
    start = hs.State(jnp.array([0.5, 0.7, 1.0]), jnp.zeros(3))
    cost = lambda k: jnp.sum(hs.simulate(Ring(k), start, t1=1.5, throw=False).final.q)
    compiled = [jax.jit(function).lower(jnp.array(2.0)).compile() for function in (cost, jax.grad(cost))]
    for program in compiled:
        assert " while(" not in entry_of(program)
    moved, slope, width = *compiled, 1e-5
    difference = (moved(jnp.array(2 + width)) - moved(jnp.array(2 - width))) / (2 * width)
    assert_close(slope(jnp.array(2.0)), difference, 1e-6)
