"""What is reported of a motion: rows of events that did not happen hold nothing that a cost could meet."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.problems.balls import RestlessBall


def motion(weight, t1=1.5):
    """Two impacts before 1.5, with room for three."""
    ball = RestlessBall(weight, jnp.array(0.8))
    return hs.simulate(ball, hs.State([1.0], [0.0]), t1=t1, max_events=3, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("t1", [1.5, 0.2], ids=["two impacts", "no impact"])
def test_rows_of_events_that_did_not_happen_are_blank(t1):
    """Also the one after the last event, on which the recorder stands where the motion ends."""
    events = motion(jnp.array(9.81), t1).events
    count = int(events.count)
    assert count == (2 if t1 == 1.5 else 0)
    assert np.all(np.isinf(events.time[count:])) and np.all(events.kind[count:] == -1)
    for rows in jax.tree.leaves((events.before, events.after, events.impulse, events.closing_speed)):
        assert np.all(rows[count:] == 0)


def test_a_sum_over_all_rows_is_that_over_the_events():
    """The speeds before two impacts, w and 0.8 w with w = sqrt(2 g): value and slope."""
    total, slope = jax.value_and_grad(lambda weight: jnp.sum(motion(weight).events.before.v))(jnp.array(9.81))
    speed = np.sqrt(2 * 9.81)
    np.testing.assert_allclose(total, -1.8 * speed, rtol=1e-12)
    np.testing.assert_allclose(slope, -1.8 / speed, rtol=1e-12)
