"""What a trace says twice is said once, and nothing else changes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import ClosedJaxpr

from hybridsens.interval.repeats import without_repeats

POINT = jnp.array([0.3, -1.2])


def equations(function, *arguments) -> int:
    """How many equations a function's trace has, those of the programs that it calls too."""

    def count(jaxpr):
        inner = [p for equation in jaxpr.eqns for p in equation.params.values() if isinstance(p, ClosedJaxpr)]
        return len(jaxpr.eqns) + sum(count(closed.jaxpr) for closed in inner)

    return count(jax.make_jaxpr(function)(*arguments).jaxpr)


def repeated(weights, x):
    """Equal terms, one of them inside a call; one unlike them only by the number in it; one that nobody needs."""
    term = lambda x: jnp.exp(jnp.sin(x) * weights["w"])
    jnp.cosh(x)
    terms = [term(x) for _ in range(12)]
    return {"sum": sum(terms) + jax.jit(term)(x) + jnp.exp(jnp.sin(x) * 2.0), "two": [weights["w"]]}


def test_the_same_numbers_by_fewer_equations():
    weights = {"w": jnp.array(0.7)}
    short = without_repeats(repeated, weights, POINT)
    assert short is not None
    assert equations(short, weights, POINT) <= 20 < equations(repeated, weights, POINT) - 20
    others = {"w": jnp.array(-0.4)}, 2 * POINT
    assert jax.tree.all(jax.tree.map(np.array_equal, short(*others), repeated(*others)))


@pytest.mark.slow
def test_derivatives_are_the_same():
    weights = {"w": jnp.array(0.7)}
    short = without_repeats(repeated, weights, POINT)
    assert short is not None
    loss = lambda function: lambda weights, x: jnp.sum(function(weights, x)["sum"] ** 2)
    both = [jax.hessian(loss(function), argnums=(0, 1))(weights, POINT) for function in (short, repeated)]
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-13), *both)


def test_numbers_of_other_types_and_signs_are_not_the_same():
    """1 and 1.0, 0.0 and -0.0 are equal to Python."""

    def function(x):
        wave = sum(jnp.sin(x) for _ in range(40))
        return wave, x / 0.0, x / -0.0, jnp.full(2, 1), jnp.full(2, 1.0), jnp.full(2, True)

    short = without_repeats(function, POINT)
    assert short is not None
    for found, right in zip(short(POINT), function(POINT), strict=True):
        assert found.dtype == right.dtype and np.array_equal(found, right)


def test_what_repeats_little_is_left_alone():
    assert without_repeats(lambda x: sum(jnp.sin(k * x) for k in range(40)), POINT) is None
    assert without_repeats(lambda x: jnp.sin(x) + jnp.sin(x), POINT) is None


def test_what_has_an_effect_is_done_as_often_as_it_is_said(capfd):
    def function(x):
        jax.debug.print("seen")
        jax.debug.print("seen")
        return sum(jnp.sin(x) for _ in range(40))

    short = without_repeats(function, POINT)
    assert short is not None
    capfd.readouterr()
    jax.block_until_ready(short(POINT))
    jax.effects_barrier()
    assert capfd.readouterr().out.count("seen") == 2
