"""Kinks and jumps of a hybrid system that are no events are warned of; scenes': `mechanics/test_discontinuities`."""

import warnings

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Tank(hs.AbstractHybridSystem):
    """x' = inflow - x until x falls to `least`, where the pump is switched."""

    inflow: jax.Array
    least: jax.Array

    def flow(self, t, x, mode):
        return jnp.where(mode == 0, self.inflow, 2.0) - x

    def guards(self, t, x, mode):
        return jnp.where(mode == 0, x - jnp.maximum(self.least, 0.0), 1.0)[None]

    def transition(self, event, t, x, mode):
        return jnp.where(x > 0, x, 0.0), 1 - mode


class PulsedTank(Tank):
    def flow(self, t, x, mode):
        return jnp.where(t < 0.5, self.inflow, 0.0) - x


class OverflowingTank(Tank):
    def flow(self, t, x, mode):
        return jnp.minimum(self.inflow - x, 0.3)


class CountedTank(Tank):
    def guards(self, t, x, mode):
        return jnp.stack([jnp.minimum(x - self.least, 2.0 - x), jnp.floor(10 * x) + 0.5])


class ComparingTank(Tank):
    def guards(self, t, x, mode):
        return jnp.where(x < self.least, -1.0, 1.0)[None]


class KnownTank(OverflowingTank):
    known_discontinuities = True


def drain(tank, **settings):
    """A few events at most; this is about what is said."""
    tank = tank(jnp.array(0.1), jnp.array(0.4))
    return hs.solve(tank, 1.0, 0, t1=1.0, max_events=4, max_steps=256, throw=False, **settings)


@pytest.mark.parametrize(
    ("tank", "words"),
    [
        (PulsedTank, ("`flow`", "jnp.where of t", "jump_ts", "known_discontinuities")),
        pytest.param(
            OverflowingTank, ("`flow`", "jnp.minimum of x", "write a guard that falls there"), marks=pytest.mark.slow
        ),
        (CountedTank, ("`guards`", "jnp.floor of x", "jnp.minimum of x", "one guard for each")),
        (ComparingTank, ("`guards`", "jnp.where of x", "what is compared", "located_discontinuities")),
    ],
)
def test_what_the_trace_shows_is_told(tank, words):
    with pytest.warns(hs.DiscontinuityWarning) as told:
        drain(tank)
    assert len(told) == 1 and all(word in str(told[0].message) for word in words), told[0].message


@jax.jit
def sinc(x):
    """It has the name of a function of JAX that is smooth although it selects inside."""
    return jnp.where(x > 0.5, 1.0, 0.0)


class OwnTank(Tank):
    def flow(self, t, x, mode):
        return super().flow(t, x, mode) - 0.1 * sinc(x)


class SmoothTank(Tank):
    def flow(self, t, x, mode):
        return super().flow(t, x, mode) - 0.1 * jnp.sinc(x) - 0.1 * jnp.hypot(x, 1.0)


@pytest.mark.slow
def test_a_function_of_ones_own_is_not_taken_for_that_of_jax():
    """Whatever it is called: a jump passed without a word, and was not located."""
    with pytest.warns(hs.DiscontinuityWarning, match="jnp.where of x"):
        drain(OwnTank)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drain(SmoothTank)


def test_a_running_cost_that_jumps_is_told():
    with pytest.warns(hs.DiscontinuityWarning, match="`running_cost` must be smooth, but has jnp.sign of x"):
        drain(Tank, running_cost=lambda tank, t, x, mode: jnp.sign(x - 0.5))


@pytest.mark.parametrize(
    "tank, settings",
    [(Tank, {}), (PulsedTank, dict(jump_ts=jnp.array([0.5]))), pytest.param(KnownTank, {}, marks=pytest.mark.slow)],
)
def test_modes_parameters_transitions_and_declared_times_break_nothing(tank, settings):
    """Nor a kink of a running cost."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drain(tank, running_cost=lambda tank, t, x, mode: jnp.abs(x - 0.5), **settings)


@pytest.mark.slow
def test_a_flow_may_close_over_what_is_differentiated():
    """While it is looked at, too: x(1) = x0 exp(-rate)."""

    def final(rate):
        class Decay(Tank):
            def flow(self, t, x, mode):
                return -rate * x

        return hs.solve(Decay(jnp.array(0.1), jnp.array(-1.0)), 1.0, 0, t1=1.0, max_events=4, max_steps=256).final

    assert_close(jax.grad(final)(0.3), -jnp.exp(-0.3), 1e-7)
