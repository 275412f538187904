"""A queue of delays is told of times that are not those of its places."""

import jax.numpy as jnp
import pytest

import hybridsens as hs


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("due", [jnp.zeros(3), jnp.array(0.0)])
def test_there_must_be_a_time_for_each_place(due):
    """Where they are asked for, and where one more is put there."""
    queue = hs.DelayQueue.empty(12)
    told = r"`due` must have a time for each place of its DelayQueue, shape \(12,\), but has shape "
    with pytest.raises(ValueError, match=told):
        queue.times(due)
    with pytest.raises(ValueError, match=told):
        queue.put(due, 1.0)
