"""The picture of a motion shows what the motion did."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

from hybridsens import Events, State, Status, Trajectory
from hybridsens.outcome import Steps
from hybridsens.plot import plot_gradients, plot_trajectory
from hybridsens.plot.figure import new_figure
from hybridsens.plot.motion import draw_lines
from hybridsens.scenes import BallsInBox, BouncingBall

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


def test_samples_behind_the_end_are_left_out():
    """Of a motion that ended before: they are nan, and hid that a contact was closed before."""
    trajectory = _lifted_ball(jnp.linspace(0, 1, 101))
    lost = jnp.where(jnp.arange(101) > 80, jnp.nan, 1.0)[:, None]
    trajectory = eqx.tree_at(lambda m: (m.q, m.v), trajectory, (trajectory.q * lost, trajectory.v * lost))
    gaps, _, contacts = plot_trajectory(BouncingBall(), trajectory).axes
    spans = np.concatenate([path.vertices[:, 0] for path in contacts.collections[0].get_paths()])
    np.testing.assert_allclose((spans.min(), spans.max()), (0, RELEASED))
    assert max(gaps.lines[0].get_xdata()) == 0.8 and gaps.get_ylabel() == "gap [m]"


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


def test_of_many_contacts_those_with_an_event_are_drawn():
    """Of four balls in a box with 22 gaps, one strikes at 0.3 and one at 0.6, and one is held at the end: written down,
    not simulated."""
    scene, ts, n = BallsInBox(4), jnp.linspace(0, 1, 5), 22
    start = scene.initial_state()
    always = lambda leaf, times: jnp.broadcast_to(leaf, (times, *leaf.shape))
    two = State(always(start.q, 2), always(start.v, 2))
    events = Events(
        jnp.array([0.3, 0.6]), jnp.array([0, 0]), jnp.array([21, 3]), two, two, jnp.zeros((2, n)), jnp.zeros(2),
        jnp.zeros(2, bool), jnp.array(2),
    )  # fmt: skip
    motion = Trajectory(
        ts, always(start.q, 5), always(start.v, 5), start, None, events, jnp.arange(n) == 8, Status.successful,
        ts[-1], jnp.array(jnp.nan), Steps(jnp.array(10), jnp.array(0)),
    )  # fmt: skip
    gaps, _, closed = plot_trajectory(scene, motion).axes
    assert [label.get_text() for label in closed.get_yticklabels()] == ["balls 1-2", "ball 1 left", "ball 3 top"]
    assert gaps.get_title(loc="left") == "3 of 22 contacts"
    drawn = [str(line.get_label()) for line in gaps.get_lines()[:3]]
    assert drawn == ["balls 1-2", "ball 1 left", "ball 3 top"]


@pytest.mark.parametrize("count", [3, 9, 16])
def test_names_of_many_lines_stand_in_rows(count):
    """Assert that none is cut off, and that no two lines look alike."""
    figure = new_figure((8, 4))
    axes = figure.subplots()
    draw_lines(axes, [0, 1], np.ones((2, count)), "gap", [f"left wall of the room and ball {i}" for i in range(count)])
    figure.draw_without_rendering()
    box, legend = figure.bbox, axes.get_legend().get_window_extent()
    assert box.x0 <= legend.x0 and legend.x1 <= box.x1 and legend.y1 <= box.y1
    assert len({(line.get_color(), line.get_linestyle()) for line in axes.get_lines()[:count]}) == count
