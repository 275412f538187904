"""Comparisons in a trace: which are found, what a function is with their outcomes held, and where they change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.located.comparisons import Comparisons

T, X = jnp.array(0.5), jnp.array([0.5, -2.0])


def found(function):
    return Comparisons(lambda t, x: (function(t, x),), (T, X))


FUNCTIONS = {
    "where": (lambda t, x: jnp.where(x[0] > 0.3, x[1], 1.0), 1),
    "at most": (lambda t, x: jnp.where(0.3 <= x[0], x[1], 1.0), 1),
    "abs": (lambda t, x: jnp.abs(x), 2),
    "sign": (lambda t, x: jnp.sign(x[0]), 1),
    "relu": (lambda t, x: jax.nn.relu(x), 2),
    "clip": (lambda t, x: jnp.clip(x[0], -1, 1), 2),
    "clamp": (lambda t, x: jax.lax.clamp(-1.0, x[0], 1.0), 2),
    "least": (lambda t, x: jnp.minimum(x[0], x[1]), 1),
    "cond": (lambda t, x: jax.lax.cond(x[0] > t + 1, lambda: x[0], lambda: x[1]), 1),
    "time": (lambda t, x: jnp.where(t < 0.7, 1.0, 2.0), 1),
    "inside of jit": (lambda t, x: jax.jit(lambda y: jnp.maximum(y, 0) ** 2)(x[0]), 1),
    "checkpoint": (lambda t, x: jax.checkpoint(lambda y: jnp.maximum(jnp.sin(y), 0))(x[0]), 1),
    "one surface": (lambda t, x: jnp.where(x[0] > 0, jnp.abs(x[0]), jnp.maximum(0, x[0])) * (x[0] <= 0), 1),
    "turned round": (lambda t, x: jnp.where(x[0] > x[1], 1.0, 2.0) + jnp.where(x[0] <= x[1], x[0], 3.0), 1),
    "elu": (lambda t, x: jax.nn.elu(x[0]), 1),
    "no comparison": (lambda t, x: jnp.sin(x[0]), 0),
    "of constants": (lambda t, x: jnp.where(jnp.array(2.0) > 1, x[0], 0.0), 0),
    "not needed": (lambda t, x: (jnp.where(x[0] > 0, 1.0, 2.0), x[0])[1], 0),
    "smooth inside": (lambda t, x: jnp.hypot(x[0], x[1]) + jnp.logaddexp(x[0], x[1]), 0),
    "table": (lambda t, x: jnp.interp(x[0], jnp.arange(3.0), jnp.arange(3.0) ** 2), 0),
    "remainder": (lambda t, x: x[0] % 1, 0),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_surface_is_found_once_and_held_outcomes_give_the_function(name):
    function, count = FUNCTIONS[name]
    compared = found(function)
    assert compared.count == count
    above = compared.outcomes(compared.differences())
    np.testing.assert_allclose(compared.held(0, above), function(T, X))


def test_with_an_outcome_held_the_function_goes_on_beyond_the_surface():
    """Value and derivative are those of the other side, and the difference tells how far it is away."""
    function = lambda t, x: (jnp.where(x[0] > 0.3, x[0] ** 2, 7.0),)
    held = lambda x: Comparisons(function, (T, x)).held(0, jnp.array([True]))
    beyond = jnp.array([0.1, 0.0])
    np.testing.assert_allclose([held(beyond), jax.grad(held)(beyond)[0]], [0.01, 0.2], rtol=1e-6)
    np.testing.assert_allclose(Comparisons(function, (T, beyond)).differences(jnp.array([True])), [-0.2], rtol=1e-6)


def test_a_comparison_inside_of_another_is_looked_at_with_the_outer_one_held():
    function = lambda t, x: (jnp.abs(jnp.where(x[0] > 0, x[1], 5.0)),)
    compared = Comparisons(function, (T, X))
    np.testing.assert_allclose(compared.differences(), [0.5, -2.0])
    np.testing.assert_allclose(compared.differences(jnp.array([False, False])), [0.5, 5.0])


STILL_BELOW = {
    "relu": lambda x: jax.nn.relu(x) > 0,
    "choice": lambda x: jnp.where(x > 0, 1.0, 0.0) > 0,
    "at least": lambda x: jnp.where(x > 0, 1.0, 0.0) >= 1,
    "sign": lambda x: jnp.sign(x) >= 1,
    "clip": lambda x: jnp.clip(x, 0, 2) > 0,
    "within a choice": lambda x: jnp.where(jax.nn.relu(x) > 0, 1.0, 0.0) > 0.5,
    "factor": lambda x: jnp.where(x > 0, 2.0, 0.0) * (1 + x**2) > 0,
}


@pytest.mark.parametrize("name", STILL_BELOW)
def test_what_stands_still_after_a_change_is_what_it_is(name):
    """Each of these is x > 0. Where x falls to 0 its own difference stays at 0 or jumps: no guard of it would fall."""
    condition = STILL_BELOW[name]
    compared = Comparisons(lambda x: (jnp.where(condition(x), 1.0, 0.0), x), (jnp.array(1e-17),))
    above = compared.outcomes(compared.differences())
    changed = jnp.arange(compared.count) == 0
    np.testing.assert_array_equal(compared.held(0, above), 1)
    np.testing.assert_array_equal(compared.held(0, compared.settled(above ^ changed, changed)), 0)


def test_a_part_that_the_mode_leaves_out_stands_still():
    """The rest keeps its outcome, also at a place where its difference does not change for the moment."""
    compared = lambda mode: Comparisons(
        lambda x, mode: (jnp.where(jnp.where(mode, x, 0.0) >= 0, 1.0, 2.0) * jnp.where(jnp.cos(x) > 2, 3.0, 5.0),),
        (jnp.array(0.0),), mode,
    )  # fmt: skip
    no, unchanged = jnp.array([False, False]), jnp.zeros(2, bool)
    assert compared(jnp.array(True)).settled(no, unchanged).tolist() == [False, False]
    assert compared(jnp.array(False)).settled(no, unchanged).tolist() == [True, False]


def test_at_equality_a_comparison_begins_as_it_is():
    conditions = lambda x: [x[0] >= 0.5, x[0] > 0.5, x[1] <= -2, x[1] < -2, x[0] <= 0.5]
    compared = found(lambda t, x: jnp.stack(conditions(x)).astype(float))
    above = compared.outcomes(compared.differences())
    assert compared.held(0, above).tolist() == [1, 0, 1, 0, 1] and compared.count == 4
