"""What `observe` may return, and what is said of anything else."""

import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens import State
from hybridsens.estimation.observers import observer, picks
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


@pytest.mark.parametrize("names", [("height [m]", "speed"), ("speed [m/s]", "height")])
def test_a_unit_behind_the_name_of_a_column_may_be_left_off(names):
    """Assert that "height" is returned for a column "height [m]", as it is for one of the state."""
    observe = lambda scene, t, q, v: {"height": q[0], "speed": v[0]}
    expected = {"height": 1.5, "speed": -0.5}
    seen = _checked(observe, names)(BouncingBall(), 0.0, START[0].q, START[0].v)
    np.testing.assert_array_equal(seen, [expected[name.split()[0]] for name in names])


def test_two_columns_are_not_one_observation():
    """Assert that of a height in metres and one in millimetres the name alone is neither."""
    with pytest.raises(ValueError, match=r"has no \['height \[m\]', 'height \[mm\]'\]: it has \['height'\]"):
        _checked(lambda scene, t, q, v: {"height": q[0]}, ("height [m]", "height [mm]"))


class Heard(BouncingBall):
    """What is measured of it stands in the class."""

    def observe(self, t, q, v):
        return {"height": q[0], "speed": v[0]}


class Misheard(BouncingBall):
    def observe(self, q, v):
        return q[0]


def test_the_scene_may_say_itself_what_was_measured():
    """Assert that its method `observe` is asked where no function is given, and that a function given comes first."""
    seen = observer(None, Heard(), START, ("speed",))(Heard(), 0.0, START[0].q, START[0].v)
    np.testing.assert_array_equal(seen, [-0.5])
    seen = observer(lambda scene, t, q, v: q, Heard(), START, ("speed",))(Heard(), 0.0, START[0].q, START[0].v)
    np.testing.assert_array_equal(seen, [1.5])
    with pytest.raises(TypeError, match=r"`def observe\(self, t, q, v\)`, but is `observe\(self, q, v\)` in Misheard"):
        observer(None, Misheard(), START, ("speed",))


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


@pytest.mark.parametrize("names", [("q0", "q[0]"), ("v0", "q0 [m]", "q_0")])
def test_two_columns_of_one_entry_are_refused(names):
    """What was measured once would count twice, and its intervals be a third too narrow."""
    with pytest.raises(ValueError, match=r"different entries of the state, but 'q0.*' and 'q.*' are of one"):
        picks(names, BouncingBall(), START)
