"""Reductions are written out, or cut into pieces: the same numbers, and no loop over windows in the program."""

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


def together(functions):
    """All of them as they are, and all of them rewritten: name -> what it returns, by two programs in place of many."""
    plain = jax.jit(lambda *x: {name: function(*x) for name, function in functions.items()})
    changed = jax.jit(lambda *x: {name: rewritten(function)(*x) for name, function in functions.items()})
    return plain, changed


def assert_same(found, right, **tolerance):
    for name in right:
        assert found[name].dtype == right[name].dtype, name
        np.testing.assert_allclose(found[name], right[name], err_msg=name, **tolerance)


@pytest.mark.parametrize("given", GIVEN)
def test_written_out_a_reduction_is_the_same(given):
    x = jnp.array(GIVEN[given])
    for function in REDUCTIONS.values():
        assert reductions(function, x)
        assert not reductions(rewritten(function), x)
    plain, changed = together(REDUCTIONS)
    assert_same(changed(x), plain(x), rtol=1e-15)


SEVERAL = {"rows", "columns", "where in each row", "in a batch"}
OF_ONE_NUMBER = {name: function for name, function in REDUCTIONS.items() if name not in SEVERAL}


@pytest.mark.parametrize("size", [5, 8])
def test_more_numbers_are_written_out_where_one_is_made_of_them(size):
    x = jnp.linspace(-1.3, 2.1, size)
    for function in OF_ONE_NUMBER.values():
        assert reductions(function, x)
        assert not reductions(rewritten(function), x)
    plain, changed = together(OF_ONE_NUMBER)
    assert_same(changed(x), plain(x), rtol=1e-14, atol=1e-15)


SEARCHES = {
    "largest": jnp.argmax,
    "smallest": jnp.argmin,
    "true": lambda x: jnp.argmax(x > 0),
    "false": lambda x: jnp.argmin(x > 9),
}


@pytest.fixture(scope="module")
def searches():
    """Of one row, and of each of several."""
    return together(SEARCHES), together({name: jax.vmap(search) for name, search in SEARCHES.items()})


@pytest.mark.parametrize("given", [*GIVEN.values(), [-np.nan], [np.inf], [-np.inf]])
def test_among_many_numbers_the_same_one_is_found(given, searches):
    """By two plain reductions: also the first of several alike, and what is no number before all others."""
    x = jnp.resize(jnp.array(given), 40)
    table = jnp.stack([x, x[::-1], jnp.zeros(40)])
    for (plain, changed), argument in zip(searches, (x, table), strict=True):
        assert "arg" not in str(jax.make_jaxpr(changed)(argument)).replace("jaxpr", "")
        assert_same(changed(argument), plain(argument), rtol=0)


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


@pytest.mark.slow
def test_a_gradient_has_hardly_a_reduction_left():
    """It had 74."""
    scene = hs.scenes.StackedBalls()
    moving, fixed = eqx.partition(jax.tree.map(jnp.asarray, scene), eqx.is_inexact_array)

    def cost(moving):
        scene = eqx.combine(moving, fixed)
        return jnp.sum(hs.simulate(scene, scene.initial_state(), t1=scene.t1, throw=False).final.q)

    program = jax.jit(jax.grad(cost)).lower(moving).compile().as_text()
    assert program.count(" reduce(") < 10


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


@pytest.mark.parametrize("size", [32, 37, 1005])
def test_cut_a_reduction_is_the_same(size):
    x, (plain, changed) = numbers(size), together(REDUCTIONS)
    assert "reduce-window" not in program(changed, x)
    assert_same(changed(x), plain(x), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(("size", "places"), [(37, (0, 30, 36)), (1005, (126, 1004))])
def test_what_is_no_number_is_found_wherever_it_stands(size, places):
    names = ["largest", "smallest", "where the largest is", "where the smallest is", "sum"]
    plain, changed = together({name: REDUCTIONS[name] for name in names})
    for place in places:
        x = numbers(size).at[place].set(jnp.nan)
        assert_same(changed(x), plain(x), rtol=0)


@pytest.mark.parametrize("size", [1, 37, 64])
def test_a_running_sum_is_the_same(size):
    x, (plain, changed) = numbers(size), together(SUMS)
    assert "reduce-window" not in program(changed, x)
    assert_same(changed(x), plain(x), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("value", [jnp.inf, -jnp.inf, jnp.nan])
def test_what_is_infinite_is_in_its_own_sums_alone(value):
    """Assert that a running sum is finite up to an entry that is not: durations of which the last one never ends."""
    x, (plain, changed) = numbers(37).at[30].set(value), together(SUMS)
    assert_same(changed(x), plain(x), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("size", [5, 40, 41, 129])
def test_integers_are_joined_bit_by_bit(size):
    """Assert that of 32 integers and more a union is no truth value."""
    for union in (jnp.bitwise_or.reduce, jnp.bitwise_and.reduce):
        x = 1 << (jnp.arange(size) % 7) | 128
        np.testing.assert_array_equal(jax.jit(rewritten(union))(x), union(x), strict=True)


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
