"""What `observe` may return, and what is said of anything else."""

import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens import State
from hybridsens.estimation.observers import observer
from hybridsens.scenes import BouncingBall

START = (State([1.5], [-0.5]),)


def _checked(observe, names=("height", "speed")):
    return observer(observe, BouncingBall(), START, names)


@pytest.mark.parametrize(
    "observe",
    [
        lambda scene, t, q, v: jnp.stack([q[0], v[0]]),
        lambda scene, t, q, v: [q[0], v[0]],
        lambda scene, t, q, v: (q[0], v[0]),
        lambda scene, t, q, v: {"speed": v[0], "height": q[0], "more": q},
    ],
    ids=["array", "list", "tuple", "mapping"],
)
def test_observations_come_as_an_array_a_list_or_by_name(observe):
    """Assert that all four give the columns in their order; what a mapping has beside them does not matter."""
    seen = _checked(observe)(BouncingBall(), 0.0, START[0].q, START[0].v)
    np.testing.assert_array_equal(seen, [1.5, -0.5])


@pytest.mark.parametrize(
    ("observe", "message"),
    [
        (lambda scene, t, q, v: {"height": q, "speed": v[0]}, r"shape \(\) for the column 'height', .* shape \(1,\)"),
        (lambda scene, t, q, v: [q[0], v], r"shape \(\) for the column 'speed', but returns shape \(1,\)"),
        (lambda scene, t, q, v: [q[0]], r"one number for each of \['height', 'speed'\], but returns a list of 1"),
        (lambda scene, t, q, v: {"height": q[0]}, r"but has no \['speed'\]"),
        (lambda scene, t, q, v: q, r"must return shape \(2,\) .* but returns \(1,\)"),
        (lambda scene, t, q, v: {"height": "q", "speed": v[0]}, "must return an array, .* but there is str"),
        (lambda scene, t, q, v: State(q, v), "must return an array, .* but there is State"),
        (lambda scene, t, q, v: None, "is a `return` missing"),
    ],
)
def test_observations_of_another_shape_are_refused(observe, message):
    """Assert that a column which is no scalar is named with its shape: of shape (1,), it would be spread over all
    samples, and the fit would converge to something else."""
    with pytest.raises((ValueError, TypeError), match=message):
        _checked(observe)
