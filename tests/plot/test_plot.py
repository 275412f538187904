"""The picture of a motion shows what the motion did."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from hybridsens import Events, State, Status, Trajectory
from hybridsens.outcome import Steps
from hybridsens.plot import plot_gradients, plot_trajectory
from hybridsens.scenes import BouncingBall

RELEASED = 0.4


def _lifted_ball(ts) -> Trajectory:
    """A ball that rests on the floor until 0.4 and then flies off: written down, not simulated."""
    flight = jnp.maximum(jnp.asarray(ts) - RELEASED, 0)
    at_release = State(jnp.zeros((1, 1)), jnp.zeros((1, 1)))
    events = Events(
        jnp.array([RELEASED]), jnp.array([2]), jnp.array([0]), at_release, at_release, jnp.zeros((1, 1)), jnp.zeros(1),
        jnp.array([False]), jnp.array(1),
    )  # fmt: skip
    steps = Steps(jnp.array(10), jnp.array(0))
    q, v = (flight**2)[:, None], (2 * flight)[:, None]
    return Trajectory(
        jnp.asarray(ts), q, v, State(q[-1], v[-1]), None, events, jnp.array([False]), Status.successful,
        jnp.asarray(ts[-1]), jnp.array(jnp.nan), steps,
    )  # fmt: skip


def test_a_contact_is_drawn_closed_until_its_release():
    """The bar of the contact covers the time before the release and no other, and the release has its mark at gap 0."""
    figure = plot_trajectory(BouncingBall(), _lifted_ball(jnp.linspace(0, 1, 101)))
    gaps, _, contacts = figure.axes
    spans = np.concatenate([path.vertices[:, 0] for path in contacts.collections[0].get_paths()])
    assert spans.min() == 0
    np.testing.assert_allclose(spans.max(), RELEASED)
    (mark,) = [line for line in gaps.lines if str(line.get_label()).startswith("release")]
    np.testing.assert_allclose(mark.get_xydata(), [[RELEASED, 0]])


def test_an_impact_is_drawn_as_a_jump():
    """The velocity line holds both states of an event at its time, before first."""
    trajectory = _lifted_ball(jnp.linspace(0, 1, 5))
    before, after = State([[0.0]], [[-3.0]]), State([[0.0]], [[2.0]])
    events = Events(
        jnp.array([0.5]), jnp.array([0]), jnp.array([0]), before, after, jnp.ones((1, 1)), jnp.ones(1),
        jnp.array([False]), jnp.array(1),
    )  # fmt: skip
    trajectory = eqx.tree_at(lambda motion: motion.events, trajectory, events)
    line = plot_trajectory(BouncingBall(), trajectory).axes[1].lines[0]
    at_event = line.get_ydata()[line.get_xdata() == 0.5]
    assert at_event[:2].tolist() == [-3.0, 2.0]


def test_bars_of_a_parameter_are_scaled_together():
    """Two methods that differ by a factor of two have bars that do, whatever the parameter's scale."""
    axes = Figure().subplots()
    plot_gradients(axes, ["mass", "floor"], {"one": np.array([1e-6, -2.0]), "two": np.array([2e-6, 0.0])})
    widths = [bar.get_width() for bars in axes.containers for bar in bars]
    np.testing.assert_allclose(widths, [0.5, -1, 1, 0])


def test_the_scale_of_gradients_has_room_for_its_ticks():
    """In a narrow panel too."""
    axes = Figure(figsize=(2, 2)).subplots()
    plot_gradients(axes, ["mass"], {"one": np.array([1.0])})
    assert axes.get_xticks().tolist() == [-1, 0, 1]


def test_rounding_is_drawn_as_zero():
    """A derivative that is zero, by a method that leaves rounding, has no bar beside one of another size."""
    axes = Figure().subplots()
    plot_gradients(axes, ["mass", "floor"], {"one": np.array([0.0, -2.0]), "two": np.array([-1e-12, -2.0])})
    widths = [bar.get_width() for bars in axes.containers for bar in bars]
    np.testing.assert_allclose(widths, [0, -1, 0, -1])


def test_a_motion_without_samples_is_refused():
    """There is nothing to draw between the events of a motion without samples."""
    trajectory = eqx.tree_at(lambda motion: motion.ts, _lifted_ball(jnp.linspace(0, 1, 3)), None)
    with pytest.raises(ValueError, match="must have samples"):
        plot_trajectory(BouncingBall(), trajectory)
