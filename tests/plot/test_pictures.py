"""Pictures show what the motion did, and moving ones have its frames."""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

import hybridsens as hs
from hybridsens.plot.animation import _outlines
from hybridsens.plot.figure import must_be_sampled, new_figure, solution_times
from hybridsens.scenes import BouncingBall
from tests.plot.test_plot_solution import switched_once
from tests.problems.balls import RestlessBall, Thrown

FALL = float(np.sqrt(2 / 9.81))
PICTURES = (hs.animate, hs.plot_trajectory, hs.plot_contacts, hs.plot_coordinates, hs.plot_phase)


class NamedBall(BouncingBall):
    """A ball that can be drawn."""

    coordinates = ("height [m]",)
    contacts = ("floor",)

    def draw(self, q):
        return [hs.planar.circle([0.0, 0.0], 0.1) + np.array([0.0, float(q[0])]), np.array([[-1.0, 0.0], [1.0, 0.0]])]


@pytest.fixture(scope="module")
def motion():
    """One bounce: from height 1, with e = 0.8, until 1."""
    ball = NamedBall()
    return hs.simulate(ball, ball.initial_state(), t1=1.0, ts=jnp.linspace(0, 1, 21))


@pytest.fixture(scope="module")
def resting():
    ball = NamedBall(height=0.0)
    return hs.simulate(ball, ball.initial_state(), t1=1.0, ts=jnp.linspace(0, 1, 21))


def test_a_costate_of_samples_is_refused(motion):
    """Assert that a cost of samples, which no part of a motion has, is told of in our words."""
    with pytest.raises(TypeError, match="`cost` must be made of what follows a sample"):
        hs.costate(motion, lambda following: jnp.sum(following.q[:, 0] ** 2))


def test_a_costate_that_is_no_number_is_told_of(motion):
    with pytest.warns(UserWarning, match="The costate is nan at 20 of 21 samples"):
        hs.costate(motion, lambda following: jnp.nan * following.final.q[0])


@pytest.mark.slow
def test_the_costate_of_a_bounce_has_its_closed_form(motion):
    """J = q(1): after the impact (1, 1 - t). Before it, a shift dq of the fall ends in -e dq with the velocity changed
    by (1 + e) g dq / w, and a dv in -e dv, carried on from there; w is the speed at which the ball strikes."""
    found = hs.costate(motion, lambda following: following.final.q[0])
    t, g, e = np.asarray(motion.ts)[:-1], 9.81, 0.8
    left, fall, w = 1 - FALL, FALL - t, g * FALL
    through = lambda dq, dv: -e * dq + left * (-e * dv + (1 + e) * g * dq / w)
    before = t < FALL
    dq = np.where(before, through(1.0, 0.0), 1.0)
    dv = np.where(before, through(fall, 1.0), 1 - t)
    np.testing.assert_allclose(found.q[:-1, 0], dq, rtol=1e-9)
    np.testing.assert_allclose(found.v[:-1, 0], dv, rtol=1e-9)
    assert np.isnan(found.q[-1, 0])
    panels = hs.plot_costate(NamedBall(), motion, lambda following: following.final.q[0]).axes
    assert [panel.get_ylabel() for panel in panels] == ["dJ/dq", "dJ/dv"]


def test_the_force_of_a_held_contact_is_the_weight(motion, resting):
    """On a ball that rests; there is none on one that only bounces."""
    _, forces = hs.contact_forces(NamedBall(), resting)
    np.testing.assert_allclose(forces, 9.81, rtol=1e-12)
    _, forces = hs.contact_forces(NamedBall(), motion)
    assert not np.any(forces)


def test_a_scene_that_holds_a_function_is_drawn(motion):
    """As that of a network does, its activation; what is computed for a picture takes it for a constant."""

    class Activated(NamedBall):
        activation: Callable = jnp.tanh

    scene = Activated()
    assert len(hs.plot_trajectory(scene, motion).axes) == 3 and len(hs.plot_contacts(scene, motion).axes) == 2


def test_impulses_are_drawn_where_they_strike(motion):
    """One dot, at the time and the impulse of the impact: (1 + e) times the speed."""
    below = hs.plot_contacts(NamedBall(), motion).axes[1]
    (dot,) = [line for line in below.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(dot.get_xydata(), [[FALL, 1.8 * 9.81 * FALL]], rtol=1e-9)


def test_where_nothing_is_ever_held_impulses_are_drawn_alone():
    ball = RestlessBall(jnp.array(9.81), jnp.array(0.8))
    motion = hs.simulate(ball, hs.State([1.0], [0.0]), t1=1.0, ts=jnp.linspace(0, 1, 5))
    (only,) = hs.plot_contacts(ball, motion).axes
    assert only.get_ylabel().startswith("impulse")


def test_coordinates_have_their_names_and_jumps(motion):
    """The phase plane goes through both sides of the impact, at height 0."""
    axes = hs.plot_phase(NamedBall(), motion, "height [m]").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("height [m]", "height rate [m/s]")
    path = axes.lines[0].get_xydata()
    speed = 9.81 * FALL
    sides = path[np.abs(path[:, 0]) < 1e-12, 1]
    np.testing.assert_allclose(sides, [-speed, 0.8 * speed], rtol=1e-9)
    rows = hs.plot_coordinates(NamedBall(), motion).axes
    assert [row.get_ylabel() for row in rows] == ["height [m]", "height rate [m/s]"]
    over_time = hs.plot_trajectory(NamedBall(), motion).axes
    assert [label.get_text() for label in over_time[2].get_yticklabels()] == ["floor"]
    for same in ("height", np.int64(0)):
        assert hs.plot_phase(NamedBall(), motion, same).axes[0].get_xlabel() == "height [m]"
    with pytest.raises(ValueError, match="one of height"):
        hs.plot_phase(NamedBall(), motion, "width")


def test_a_path_goes_over_two_coordinates_in_one_scale(unchecked):
    """Assert start, end and impacts of a ball that is thrown, by names and by numbers; and what axes are not."""
    room = Thrown(mass=jnp.array(1.0))
    start = hs.State(jnp.array([0.0, 1.0]), jnp.array([2.0, 0.0]))
    flight = hs.simulate(room, start, t1=1.0, ts=jnp.linspace(0.0, 1.0, 20))
    axes = hs.plot_path(room, flight, "x1", "y1 [m]").axes[0]
    path, *marked = (line.get_xydata() for line in axes.lines)
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x1 [m]", "y1 [m]", 1.0)
    q = np.asarray(flight.q)
    np.testing.assert_allclose(path[[0, -1]], q[[0, -1]])
    *impacts, start, end = marked
    np.testing.assert_allclose([start[0], end[0]], q[[0, -1]])
    assert sum(map(len, impacts)) == int(flight.events.count) >= 1
    assert hs.plot_path(room, flight, 1, 0).axes[0].get_xlabel() == "y1 [m]"
    for draw in (hs.plot_path, hs.plot_phase):
        with pytest.raises(TypeError, match="`axes` must be axes of Matplotlib"):
            draw(room, flight, 0, axes="y1 [m]")


def test_an_animation_has_a_frame_for_each_of_its_times(motion, tmp_path):
    """Eleven frames for a second at ten a second; a page, too; and clear words where nothing can be drawn."""
    moving = hs.animate(NamedBall(), motion, frames_per_second=10, size=(2.0, 2.0))
    moving.save(tmp_path / "ball.gif")
    with Image.open(tmp_path / "ball.gif") as gif:
        assert gif.n_frames == 11
        first, last = (np.asarray(gif.convert("L")) for k in (0, 10) if gif.seek(k) is None)
    assert np.any(first != last)
    assert moving._repr_html_().startswith("<img src='data:image/gif;base64,")
    with pytest.raises(ValueError, match=r"\.gif or \.html"):
        moving.save(tmp_path / "ball.mp4")
    with pytest.raises(ValueError, match="`draw` must be given for a FootedBlock"):
        hs.animate(hs.scenes.FootedBlock(), motion)
    with pytest.raises(ValueError, match="raise `speed`"):
        hs.animate(NamedBall(), motion, speed=0.01)


@pytest.mark.parametrize(("asked", "milliseconds"), [(10, 100), (15, 70), (33, 30), (200, 20)])
def test_a_gif_keeps_the_pace_of_the_motion(asked, milliseconds, motion, tmp_path):
    """Its frames last whole hundredths of a second, two at least; frames of other lengths were shown by those of the
    next shorter one, a fifth too fast."""
    moving = hs.animate(NamedBall(), motion, frames_per_second=asked, size=(1.0, 1.0))
    moving.save(tmp_path / "ball.gif")
    with Image.open(tmp_path / "ball.gif") as gif:
        shown = sum(gif.info["duration"] for k in range(gif.n_frames) if gif.seek(k) is None)  # alike ones are joined
    assert shown == milliseconds * moving.frames
    assert 0 <= (moving.frames - 1) * milliseconds - 1000 * np.ptp(motion.ts) < milliseconds


@pytest.mark.parametrize(("ts", "frames"), [([0.0, 0.2, 0.4, 1.2, 1.4], 3), ([0.0, 1.2], 1)])
def test_a_motion_that_broke_off_is_shown_as_far_as_it_came(ts, frames, tmp_path):
    """It ends at its second impact, at 1.17: the last frame is of the last sample before, be it the first one."""
    hs.animate(NamedBall(), _broken_off(ts), frames_per_second=5, size=(2.0, 2.0)).save(tmp_path / "ball.gif")
    with Image.open(tmp_path / "ball.gif") as gif:
        assert gif.n_frames == frames


def test_a_motion_that_broke_off_has_no_costate():
    """Started again at a sample it would have room for more events, and end elsewhere."""
    with pytest.raises(ValueError, match=r"must be that of a motion that reached t1, but .* broke off at t = 1\.17"):
        hs.costate(_broken_off([0.0, 0.2, 1.2]), lambda following: following.final.q[0])


def test_a_motion_that_reached_no_sample_is_not_shown():
    """And is told why."""
    with pytest.raises(ValueError, match="must have reached one of its samples.* broke off before t = 1.2: .*`status`"):
        hs.animate(NamedBall(), _broken_off([1.2, 1.4]))


def _broken_off(ts):
    ball = NamedBall()
    return hs.simulate(ball, ball.initial_state(), t1=1.5, ts=jnp.asarray(ts), max_events=1, throw=False)


def test_samples_at_no_time_are_told_of():
    """In pictures that move and in those that do not."""
    ball = NamedBall()
    motion = hs.simulate(ball, ball.initial_state(), t1=0.3, ts=jnp.zeros(0))
    costate = lambda scene, motion: hs.plot_costate(scene, motion, lambda following: following.final.q[0])
    for draw in (*PICTURES, costate):
        with pytest.raises(ValueError, match="`ts` must hold at least one time where `trajectory` is made"):
            draw(ball, motion)


def test_a_figure_shows_itself_in_a_notebook():
    """As a PNG, without pyplot."""
    assert new_figure((1, 1))._repr_png_().startswith(b"\x89PNG")


def test_a_picture_of_a_motion_of_the_other_kind_is_refused(motion):
    """And the one that draws it is named."""
    with pytest.raises(TypeError, match="`trajectory` must be a motion, as `simulate` .* drawn by plot_solution"):
        must_be_sampled(switched_once({"on": jnp.array(True)}))
    with pytest.raises(TypeError, match="`solution` must be a motion, as `solve` .* drawn by plot_trajectory"):
        solution_times(motion)
    with pytest.raises(TypeError, match="is NamedBall: what moved comes first, and its motion second"):
        must_be_sampled(NamedBall())


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (dict(speed=0.0), "`speed` must be a positive number, but is 0.0"),
        (dict(speed=float("nan")), "`speed` must be a positive number, but is nan"),
        (dict(frames_per_second=-1.0), "`frames_per_second` must be a positive number, but is -1.0"),
        (dict(draw=lambda q: []), "`draw` must return a list of outlines"),
        (dict(draw=lambda q: np.zeros((5, 2))), "`draw` must return a list of outlines.* put a single outline into"),
        (dict(draw=lambda q, t: [np.zeros((5, 2))] * (2 if t > 0.5 else 1)), "`draw` must return as many outlines"),
    ],
)
def test_an_animation_that_cannot_be_made_says_why(motion, given, message):
    with pytest.raises(ValueError, match=message):
        hs.animate(NamedBall(), motion, **given)


def test_outlines_come_from_any_function(motion, tmp_path):
    """A partial one, a compiled one, one with a default that is no time; at any pace."""
    body = lambda radius, q: [jnp.stack([jnp.zeros(2), radius + jnp.array([q[0], q[0]])])]
    partial = functools.partial(body, 0.1)
    for draw in (partial, jax.jit(partial), lambda q, radius=0.1: body(radius, q)):
        moving = hs.animate(NamedBall(), motion, draw, frames_per_second=0.4, size=(2.0, 2.0))
        moving.save(tmp_path / "slow.gif")
        moving.save(tmp_path / "slow.html")
        with Image.open(tmp_path / "slow.gif") as gif:
            assert gif.n_frames == 2 and gif.info["duration"] == 2500
    outlines = _outlines(NamedBall(), lambda q, radius=0.1: body(radius, q))
    np.testing.assert_allclose(outlines(np.ones(1), 7.0)[0][1], [1.1, 1.1])
