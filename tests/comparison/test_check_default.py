"""A check, made at a tight tolerance, says what is left of the gradient at the default tolerance of motions."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.check_default import DEFAULT, AtDefault, at_default
from hybridsens.parameters import flatten_parameters


class Decay(hs.AbstractHybridSystem):
    """x' = -rate x, without an event."""

    rate: jax.Array

    def flow(self, t, x, mode):
        return -self.rate * x

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


def last(system, solve):
    return solve(system, jnp.array(1.0), t1=1.0).final


def test_the_default_tolerance_is_that_of_simulate_and_solve():
    for function in (hs.simulate, hs.solve):
        given = inspect.signature(function).parameters
        assert given["rtol"].default == given["atol"].default == DEFAULT


def test_what_is_off_at_the_default_tolerance_is_measured():
    """As the difference of the gradients at both; at a tolerance that is no tighter nothing is asked."""
    tight = dict(rtol=1e-12, atol=1e-12, max_events=4, max_steps=1024)
    by_rate = lambda rate, tol: last(Decay(rate), lambda *start, **to: hs.solve(*start, **to, rtol=tol, atol=tol))
    exact, off = (float(jax.jit(jax.grad(by_rate))(2.0, tol)) for tol in (1e-12, 1e-8))
    measured = lambda settings: at_default(
        flatten_parameters(Decay(jnp.array(2.0))), last, hs.Replay(), settings, np.array([exact]), np.array([1.0])
    )
    found = measured(tight)
    assert found is not None and found.parameter == "rate"
    assert found.deviation == pytest.approx(abs(off - exact), rel=1e-3) and 1e-12 < found.deviation < 1e-6
    assert measured(tight | dict(rtol=1e-8)) is None


@pytest.mark.parametrize(
    ("deviation", "told"),
    [(3e-7, "the gradient is this one to 3.0e-07."), (1.8, "by mass is off by 1.8e+00"), (np.nan, "is not successful")],
)
def test_it_is_told_in_a_sentence(deviation, told):
    """With a remedy where it is far off, and where the motion does not succeed at that tolerance."""
    words = " ".join(str(AtDefault("mass", deviation)).split())
    assert words.startswith("At the default tolerance of a motion, rtol = atol = 1e-08,") and told in words
    assert ("tighten rtol and atol" in words) == (deviation != 3e-7)
