"""Reductions of few numbers are written out: the same numbers, and a gradient with hardly a reduction left."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.xla.rewriting import rewritten
from tests.closeness import assert_close

REDUCTIONS = {
    "sum": jnp.sum,
    "largest": jnp.max,
    "smallest": jnp.min,
    "any": lambda x: jnp.any(x > 0),
    "all": lambda x: jnp.all(x > 0),
    "where the largest is": jnp.argmax,
    "where the smallest is": jnp.argmin,
    "where one is true": lambda x: jnp.argmax(x > 0),
    "product of vectors": lambda x: x @ jnp.cos(x),
    "norm": jnp.linalg.norm,
    "rows": lambda x: jnp.sum(jnp.outer(x, jnp.sin(x)), axis=1),
    "columns": lambda x: jnp.max(jnp.outer(x, jnp.sin(x)), axis=0),
    "where in each row": lambda x: jnp.argmin(jnp.outer(x, jnp.sin(x)), axis=1),
    "in a loop": lambda x: jax.lax.fori_loop(0, 3, lambda _, x: x / jnp.sum(x), x),
    "in a batch": jax.vmap(lambda x: jnp.sum(jnp.stack([x, x**2]))),
}

GIVEN = {
    "one": [0.7],
    "several": [0.4, -1.3, 2.1],
    "alike": [1.5, 1.5, -2.0, -2.0],
    "no number": [0.2, np.nan, 3.0, np.nan],
    "infinite": [-np.inf, 1.0, np.inf],
}


def reductions(function, x) -> bool:
    """Whether its trace holds one, or a product of two vectors, which becomes one."""
    trace = str(jax.make_jaxpr(function)(x))
    return any(word in trace for word in ("reduce_", "argmax", "argmin", "dot_general"))


@pytest.mark.parametrize("name", REDUCTIONS)
@pytest.mark.parametrize("given", GIVEN)
def test_written_out_a_reduction_is_the_same(name, given):
    x, function = jnp.array(GIVEN[given]), REDUCTIONS[name]
    assert reductions(function, x)
    assert not reductions(rewritten(function), x)
    found, right = jax.jit(rewritten(function))(x), jax.jit(function)(x)
    assert found.dtype == right.dtype
    np.testing.assert_allclose(found, right, rtol=1e-15)


OF_ONE_NUMBER = set(REDUCTIONS) - {"rows", "columns", "where in each row", "in a batch"}


@pytest.mark.parametrize("name", sorted(OF_ONE_NUMBER))
@pytest.mark.parametrize("size", [5, 8])
def test_more_numbers_are_written_out_where_one_is_made_of_them(name, size):
    x, function = jnp.linspace(-1.3, 2.1, size), REDUCTIONS[name]
    assert reductions(function, x)
    assert not reductions(rewritten(function), x)
    np.testing.assert_allclose(jax.jit(rewritten(function))(x), jax.jit(function)(x), rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("given", [*GIVEN.values(), [-np.nan], [np.inf], [-np.inf]])
@pytest.mark.parametrize("search", [jnp.argmax, jnp.argmin, lambda x: jnp.argmax(x > 0), lambda x: jnp.argmin(x > 9)])
def test_among_many_numbers_the_same_one_is_found(search, given):
    """By two plain reductions: also the first of several alike, and what is no number before all others."""
    x = jnp.resize(jnp.array(given), 40)
    one, rows = search, jax.vmap(search)
    table = jnp.stack([x, x[::-1], jnp.zeros(40)])
    for function, argument in ((one, x), (rows, table)):
        assert "arg" not in str(jax.make_jaxpr(rewritten(function))(argument))
        found, right = jax.jit(rewritten(function))(argument), jax.jit(function)(argument)
        assert found.dtype == right.dtype
        np.testing.assert_array_equal(found, right)


@pytest.mark.parametrize("name", ["sum", "largest", "product of vectors", "norm", "rows", "in a loop"])
def test_its_derivative_is_the_same(name):
    x, function = jnp.array([0.4, -1.3, 2.1]), REDUCTIONS[name]
    for derivative in (jax.jacrev, jax.jacfwd):
        assert_close(derivative(rewritten(function))(x), derivative(function)(x), 1e-15, scale=1.0)


@pytest.mark.parametrize(
    "function",
    [
        lambda x: jnp.sum(jnp.resize(x, 17)),
        lambda x: jnp.sum(jnp.outer(x, jnp.resize(x, 5)), axis=1),
        lambda x: jnp.sum(jnp.outer(x, x)),
        lambda x: jnp.max(jnp.outer(x, jnp.arange(17.0)), axis=0),
        lambda x: jnp.outer(x, x) @ x,
        lambda x: jnp.sum(x[:0]),
        lambda x: jnp.dot(x, x.astype(jnp.float32)),
        lambda x: jnp.dot(x.astype(jnp.float32), x.astype(jnp.float32), preferred_element_type=jnp.float64),
        lambda x: jnp.dot(x.astype(jnp.int8), x.astype(jnp.int8), preferred_element_type=jnp.int32),
    ],
)
def test_of_many_numbers_or_with_a_large_result_it_is_left_to_the_compiler(function):
    x = jnp.array([0.4, -1.3, 2.1])
    assert str(jax.make_jaxpr(rewritten(function))(x)) == str(jax.make_jaxpr(function)(x))


def test_a_gradient_has_hardly_a_reduction_left():
    """It had 74."""
    scene = hs.scenes.StackedBalls()
    moving, fixed = eqx.partition(jax.tree.map(jnp.asarray, scene), eqx.is_inexact_array)

    def cost(moving):
        scene = eqx.combine(moving, fixed)
        return jnp.sum(hs.simulate(scene, scene.initial_state(), t1=scene.t1, throw=False).final.q)

    program = jax.jit(jax.grad(cost)).lower(moving).compile().as_text()
    assert program.count(" reduce(") < 10
