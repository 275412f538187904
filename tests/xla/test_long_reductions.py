"""Long reductions are cut: the same numbers, and no loop over windows in the program."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.xla.rewriting import rewritten
from tests.closeness import assert_close
from tests.xla.test_reductions import REDUCTIONS

SUMS = {
    "running": jnp.cumsum,
    "from the end": lambda x: jnp.cumsum(x[::-1])[::-1],
    "along rows": lambda x: jnp.cumsum(jnp.outer(x, jnp.sin(x)), axis=1),
    "along columns": lambda x: jnp.cumsum(jnp.outer(x, jnp.sin(x)), axis=0),
    "in a batch": lambda x: jax.vmap(jnp.cumsum)(jnp.stack([x, x**2])),
}


def program(function, x) -> str:
    return jax.jit(function).lower(x).compile().as_text()


def numbers(size: int):
    return jnp.asarray(np.random.default_rng(size).normal(size=size))


@pytest.mark.parametrize("name", REDUCTIONS)
@pytest.mark.parametrize("size", [32, 37, 1005])
def test_cut_a_reduction_is_the_same(name, size):
    x, function = numbers(size), REDUCTIONS[name]
    assert "reduce-window" not in program(rewritten(function), x)
    found, right = jax.jit(rewritten(function))(x), jax.jit(function)(x)
    assert found.dtype == right.dtype
    np.testing.assert_allclose(found, right, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("search", ["largest", "smallest", "where the largest is", "where the smallest is", "sum"])
@pytest.mark.parametrize(("size", "place"), [(37, 0), (37, 30), (37, 36), (1005, 126), (1005, 1004)])
def test_what_is_no_number_is_found_wherever_it_stands(search, size, place):
    x = numbers(size).at[place].set(jnp.nan)
    np.testing.assert_array_equal(jax.jit(rewritten(REDUCTIONS[search]))(x), REDUCTIONS[search](x))


@pytest.mark.parametrize("name", SUMS)
@pytest.mark.parametrize("size", [1, 37, 64])
def test_a_running_sum_is_the_same(name, size):
    x, function = numbers(size), SUMS[name]
    assert "reduce-window" not in program(rewritten(function), x)
    np.testing.assert_allclose(jax.jit(rewritten(function))(x), function(x), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("function", [SUMS["running"], SUMS["from the end"], *map(REDUCTIONS.get, ("sum", "norm"))])
@pytest.mark.parametrize("size", [40, 300])
def test_its_derivatives_are_the_same(function, size):
    x = numbers(size)
    for derivative in (jax.jacrev, jax.jacfwd):
        assert_close(derivative(rewritten(function))(x), derivative(function)(x), 1e-14, scale=1.0)


@pytest.mark.parametrize("dtype", ["float32", "int32", "bool"])
@pytest.mark.parametrize("function", [jnp.sum, jnp.max, jnp.cumsum, jnp.argmax])
def test_types_stay(function, dtype):
    x = (10 * numbers(40)).astype(dtype)
    found, right = jax.jit(rewritten(function))(x), function(x)
    assert found.dtype == right.dtype
    np.testing.assert_allclose(found, right, rtol=1e-5)


@pytest.mark.parametrize("size", [40, 300])
def test_small_integers_are_not_widened(size):
    """Assert that a sum in a type of its own keeps it, and what is made of the sum can be traced."""
    x = jnp.arange(size, dtype=jnp.int32)
    for function in (lambda x: jnp.sum(x, dtype=jnp.int32) + x, lambda x: (x @ x) * x):
        np.testing.assert_array_equal(jax.jit(rewritten(function))(x), function(x), strict=True)


@pytest.mark.parametrize(("function", "size"), [(jnp.sum, 16385), (jnp.max, 16385), (jnp.cumsum, 65)])
def test_what_is_longer_stays_as_it_is(function, size):
    x = numbers(size)
    assert str(jax.make_jaxpr(rewritten(function))(x)) == str(jax.make_jaxpr(function)(x))
