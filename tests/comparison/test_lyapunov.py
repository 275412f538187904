"""Growth of variations, against a closed form."""

import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs


class Saddle(hs.AbstractHybridSystem):
    """a' = a, b' = -b, without events."""

    def flow(self, t, x, mode):
        return {"a": x["a"], "b": -x["b"]}

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


@pytest.mark.slow
@pytest.mark.parametrize("state", [{"a": 1, "b": 2}, {"a": 1.0, "b": 2}])
def test_numbers_of_the_state_may_be_integers(state):
    """Assert that what `solve` takes as x0 grows by e, and has exponent 1."""
    found = hs.lyapunov(Saddle(), state, t1=1.0)
    np.testing.assert_allclose(found.matrix, np.diag([np.e, 1 / np.e]), rtol=1e-6)
    assert float(found.exponent) == pytest.approx(1, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("max_events", "reached"), [(4, True), (1, False)])
def test_a_motion_that_broke_off_has_no_exponent(max_events, reached):
    """Assert that the growth of a part of the horizon is not spread over all of it: a ball that breaks off at its
    second impact keeps its growth, and has the exponent nan."""
    ball = hs.scenes.BouncingBall()
    found = hs.lyapunov(ball, ball.initial_state(), t1=1.5, max_events=max_events, throw=False)
    assert bool(found.trajectory.status.reached_end) == reached
    assert np.isfinite(found.growth) and np.isfinite(found.matrix).all()
    assert np.isfinite(found.exponent) == reached


class Decay(Saddle):
    """x' = -x."""

    def flow(self, t, x, mode):
        return -x


@pytest.mark.parametrize(("t1", "exponent"), [(25.0, -1), (40.0, np.nan)])
def test_what_has_shrunk_to_rounding_has_no_exponent(t1, exponent):
    """Assert that no exponent is made of rounding: of e^-40 it was wrong by a half and more."""
    found = hs.lyapunov(Decay(), 1.0, t1=t1)
    np.testing.assert_allclose(found.exponent, exponent, rtol=1e-6)


@pytest.mark.slow
def test_what_grows_is_printed_in_a_few_lines():
    found = str(hs.lyapunov(Saddle(), {"a": 1.0, "b": 2.0}, t1=1.0))
    assert found.startswith("exponent 1: a variation of the initial state grows 2.71828 times, at most")
    assert "[[2.718282 0.]" in found and found.endswith("motion: successful, 0 events")


def test_a_motion_that_breaks_off_is_told_in_forward_mode():
    """Assert that its status is raised: times of events are known by their tangents alone there, and are left out."""
    with pytest.raises(hs.SimulationError, match="max_events_reached"):
        hs.lyapunov(hs.systems.Thermostat(), 20.0, False, t1=500.0, max_events=3)
