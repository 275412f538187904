"""A running cost that is written in place compiles once, unless something that it names may have changed."""

import gc
import math
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.validation.same_function import same_function
from tests.problems.balls import RestlessBall

NUMBER, TABLE = 2.0, np.ones(3)


def helper(x):
    return x


MADE = {
    "of its arguments": lambda: lambda x: x + 1,
    "of JAX's modules": lambda: lambda x: jnp.sin(x) + math.pi * np.pi,
    "of a number": lambda: lambda x: NUMBER * x,
    "with one inside": lambda: lambda x: [jnp.cos(y) for y in x],
}


def closing_over(number):
    return lambda x: number * x


UNKNOWN = {
    "of an array": lambda: lambda x: TABLE * x,
    "of a function": lambda: lambda x: helper(x),
    "of a function inside": lambda: lambda x: [helper(y) for y in x],
    "of what it closes over": lambda: closing_over(1.0),
    "with a default": lambda: lambda x, y=1.0: x * y,
}


@pytest.mark.parametrize("make", MADE.values(), ids=MADE)
def test_a_function_made_anew_is_the_one_before(make):
    first = same_function(make())
    assert same_function(make()) is first


@pytest.mark.parametrize("make", UNKNOWN.values(), ids=UNKNOWN)
def test_what_may_have_changed_is_another(make):
    first, second = make(), make()
    assert same_function(first) is first and same_function(second) is second


def test_a_number_that_changed_makes_another(monkeypatch):
    """Also one of another type: 2 is an integer to JAX."""
    first = same_function(MADE["of a number"]())
    for value in (3.0, 2):
        monkeypatch.setitem(globals(), "NUMBER", value)
        assert same_function(MADE["of a number"]()) is not first
    monkeypatch.setitem(globals(), "NUMBER", 2.0)
    assert same_function(MADE["of a number"]()) is first


def test_what_is_no_plain_function_stays():
    for function in (None, jnp.sin, jax.jit(helper), np.sin):
        assert same_function(function) is function


def test_one_that_nobody_holds_is_forgotten():
    gone = weakref.ref(same_function(MADE["of its arguments"]()))
    gc.collect()
    assert gone() is None


def test_a_cost_in_place_is_compiled_once():
    """It took seconds at each call, and memory."""
    compilations = []
    count = lambda event, _, **__: compilations.append(event) if "backend_compile" in event else None

    def energy(weight):
        ball, start = RestlessBall(weight, jnp.array(0.8)), hs.State([1.0], [0.0])
        return hs.simulate(ball, start, t1=0.2, running_cost=lambda scene, t, q, v: v @ v / 2, max_events=4).cost

    first = jax.grad(energy)(jnp.array(9.81))
    jax.monitoring.register_event_duration_secs_listener(count)
    second = jax.grad(energy)(jnp.array(9.9))
    assert not compilations
    np.testing.assert_allclose([first, second], [2 * w * 0.2**3 / 6 for w in (9.81, 9.9)], rtol=1e-8)
