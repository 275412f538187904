"""Comparisons in a trace: which are found, what a function is with their outcomes held, and where they change."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.located.comparisons import Comparisons
from hybridsens.located.outcomes import Outcomes


@jax.jit
def remainder(x, y):
    return jnp.maximum(x, -y)


T, X = jnp.array(0.5), jnp.array([0.5, -2.0])


def found(function):
    return Comparisons(lambda t, x: (function(t, x),), (T, X))


FUNCTIONS = {
    "where": (lambda t, x: jnp.where(x[0] > 0.3, x[1], 1.0), 1),
    "at most": (lambda t, x: jnp.where(0.3 <= x[0], x[1], 1.0), 1),
    "abs": (lambda t, x: jnp.abs(x), 2),
    "sign": (lambda t, x: jnp.sign(x[0]), 2),
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
    "smooth by a shift": (lambda t, x: jax.nn.softmax(jnp.append(x, t))[0], 0),  # the shift is bounded at infinity
    "table": (lambda t, x: jnp.interp(x[0], jnp.arange(3.0), jnp.arange(3.0) ** 2), 0),
    "looped": (lambda t, x: jax.lax.fori_loop(0, 2, lambda k, y: jnp.maximum(y, x[0]), 0.0), 0),
    "of many": (lambda t, x: jnp.max(x[0] + jnp.arange(17.0)), 0),
    "largest": (lambda t, x: jnp.max(jnp.stack([t, x[0], x[1]])), 2),
    "which is largest": (lambda t, x: 1.0 * jnp.argmax(jnp.stack([t, x[0], x[1], 2 * t])), 3),
    "least of rows": (lambda t, x: jnp.min(jnp.outer(x, jnp.array([t, 1.0, -1.0])), axis=1), 4),
    "floor": (lambda t, x: jnp.floor(x), 4),
    "ceil": (lambda t, x: jnp.ceil(x[0]), 2),
    "round": (lambda t, x: jnp.round(3 * x[1]), 2),
    "remainder": (lambda t, x: x[1] % 0.7, 2),
    "whole part": (lambda t, x: x[1] // 0.7, 2),
    "both parts": (lambda t, x: sum(jnp.divmod(x[1], 0.7)), 2),
    "rest of a division": (lambda t, x: jnp.fmod(x[1], 0.7), 5),
    "rounded to a place": (lambda t, x: jnp.round(x[0] + 0.03, 1), 2),
    "of another's name": (lambda t, x: remainder(x[1], 0.7), 1),
    "truncated": (lambda t, x: jnp.trunc(x[1] - 0.3), 5),
    "equal at points": (lambda t, x: jnp.where(x[0] == 0.5, 1.0, x[0]), 0),
    "no number": (lambda t, x: jnp.where(jnp.isnan(jnp.maximum(x[0], t)), 0.0, x[1]), 1),
    "saturated": (lambda t, x: 1.0 * (jnp.clip(x[0], -1, 1) == x[0]), 5),
    "open": (lambda t, x: 1.0 * (jax.nn.relu(x[0]) != 0), 2),
    "one of two": (lambda t, x: 1.0 * (jnp.minimum(x[0], t) != t), 2),
    "its own size": (lambda t, x: 1.0 * (jnp.abs(x[1]) == x[1]), 3),
    "number of a floor": (lambda t, x: 1.0 * (jnp.floor(x[1]) == -2), 4),
    "root of a square": (lambda t, x: jnp.sqrt(x[0] ** 2), 1),
    "norm of one number": (lambda t, x: 2 * x[0] / jnp.linalg.norm(x[:1]), 2),
    "norm of two": (lambda t, x: jnp.linalg.norm(x), 0),
    "angle": (lambda t, x: jnp.arctan2(x[1], x[0]), 2),
}
"""With the number of guards that tell where an outcome changes: two of each floor."""





@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_surface_is_found_once_and_held_outcomes_give_the_function(name):
    function, count = FUNCTIONS[name]
    compared = found(function)
    outcomes = compared.outcomes()
    assert compared.guards(outcomes).shape == (outcomes.guard_count,) == (count,)
    assert np.all(np.asarray(compared.guards(outcomes)) >= 0)
    np.testing.assert_allclose(compared.held(0, outcomes), function(T, X), rtol=1e-6)


def test_with_an_outcome_held_the_function_goes_on_beyond_the_surface():
    """Value and derivative are those of the other side, and the difference tells how far it is away."""
    function = lambda t, x: (jnp.where(x[0] > 0.3, x[0] ** 2, 7.0),)
    above = Outcomes(jnp.array([True]), jnp.zeros(0))
    held = lambda x: Comparisons(function, (T, x)).held(0, above)
    beyond = jnp.array([0.1, 0.0])
    np.testing.assert_allclose([held(beyond), jax.grad(held)(beyond)[0]], [0.01, 0.2], rtol=1e-6)
    np.testing.assert_allclose(Comparisons(function, (T, beyond)).guards(above), [-0.2], rtol=1e-6)


def test_a_comparison_inside_of_another_is_looked_at_with_the_outer_one_held():
    function = lambda t, x: (jnp.abs(jnp.where(x[0] > 0, x[1], 5.0)),)
    compared = Comparisons(function, (T, X))
    np.testing.assert_allclose(compared.differences().surface, [0.5, -2.0])
    below = Outcomes(jnp.array([False, False]), jnp.zeros(0))
    np.testing.assert_allclose(compared.differences(below).surface, [0.5, 5.0])


@pytest.mark.parametrize("place", [2.0, 3.0, -1.0, 0.0])
def test_a_floor_turns_its_guard_where_it_is_passed(place):
    """The guard that fell is on 0 and rising, the other one half a way of 2 off: neither would fall again."""
    at = lambda x: Comparisons(lambda x: (jnp.floor(x),), (jnp.array(x),))
    for way, before, after in ((1, place - 1, place), (-1, place, place - 1)):
        outcomes = at(place - way * 1e-9).outcomes()
        assert outcomes.whole.tolist() == [before]
        fell = jnp.argmin(at(place).guards(outcomes))
        passed = at(place).after(fell, outcomes)
        assert passed.whole.tolist() == [after]
        np.testing.assert_allclose(np.sort(at(place).guards(passed)), [0, 1])
        assert at(place + way * 0.1).guards(passed)[fell] > 0


def test_a_floor_goes_to_where_a_jump_has_led():
    at = lambda x: Comparisons(lambda x: (jnp.floor(x),), (jnp.array(x),))
    outcomes = at(0.5).outcomes()
    fell = jnp.argmin(at(7.5).guards(outcomes))
    assert at(7.5).after(fell, outcomes).whole.tolist() == [7]


STILL_BELOW = {
    "relu": lambda x: jax.nn.relu(x) > 0,
    "choice": lambda x: jnp.where(x > 0, 1.0, 0.0) > 0,
    "at least": lambda x: jnp.where(x > 0, 1.0, 0.0) >= 1,
    "sign": lambda x: jnp.sign(x) >= 1,
    "clip": lambda x: jnp.clip(x, 0, 2) > 0,
    "within a choice": lambda x: jnp.where(jax.nn.relu(x) > 0, 1.0, 0.0) > 0.5,
    "factor": lambda x: jnp.where(x > 0, 2.0, 0.0) * (1 + x**2) > 0,
    "floor": lambda x: jnp.floor(jnp.where(x > 0, 1.5, 0.5)) > 0,
}


@pytest.mark.parametrize("name", STILL_BELOW)
def test_what_stands_still_after_a_change_is_what_it_is(name):
    """Each of these is x > 0. Where x falls to 0 its own difference stays at 0 or jumps: no guard of it would fall."""
    condition = STILL_BELOW[name]
    compared = Comparisons(lambda x: (jnp.where(condition(x), 1.0, 0.0), x), (jnp.array(1e-17),))
    outcomes = compared.outcomes()
    np.testing.assert_array_equal(compared.held(0, outcomes), 1)
    np.testing.assert_array_equal(compared.held(0, compared.after(jnp.array(0), outcomes)), 0)


def test_a_part_that_the_mode_leaves_out_stands_still():
    """The rest keeps its outcome, also at a place where its difference does not change for the moment."""
    compared = lambda mode: Comparisons(
        lambda x, mode: (jnp.where(jnp.where(mode, x, 0.0) >= 0, 1.0, 2.0) * jnp.where(jnp.cos(x) > 2, 3.0, 5.0),),
        (jnp.array(0.0),), mode,
    )  # fmt: skip
    below = Outcomes(jnp.array([False, False]), jnp.zeros(0))
    after = lambda mode: compared(jnp.array(mode)).after(jnp.array(-1), below).above.tolist()
    assert after(True) == [False, False]
    assert after(False) == [True, False]


def test_at_equality_a_comparison_begins_as_it_is():
    conditions = lambda x: [x[0] >= 0.5, x[0] > 0.5, x[1] <= -2, x[1] < -2, x[0] <= 0.5]
    compared = found(lambda t, x: jnp.stack(conditions(x)).astype(float))
    outcomes = compared.outcomes()
    assert compared.held(0, outcomes).tolist() == [1, 0, 1, 0, 1] and outcomes.guard_count == 4
