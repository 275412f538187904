"""The picture of a hybrid system's motion: which panels it has, and what is drawn in them."""

import dataclasses
import types

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.outcome import Steps
from hybridsens.solution import SolutionEvents


def test_whole_modes_have_whole_ticks_and_only_several_a_legend():
    """Of one number; of two; of a number that is real."""
    modes = ({"gear": 2}, {"gear": 2, "visits": 1}, {"speed": 0.5})
    panels = [hs.plot_solution(switched_once(mode)).axes[1] for mode in modes]
    assert [panel.get_ylabel() for panel in panels] == ["mode.gear", "mode", "mode.speed"]
    assert [panel.get_legend() is not None for panel in panels] == [False, True, False]
    whole = [all(tick == round(tick) for tick in panel.get_yticks()) for panel in panels]
    assert whole == [True, True, False]


def test_a_counter_in_the_mode_has_a_panel_of_its_own():
    """It would flatten the small numbers beside it."""
    panels = hs.plot_solution(switched_once({"gear": 1, "side": 0, "visits": 99})).axes
    assert [panel.get_ylabel() for panel in panels[1:]] == ["mode", "mode.visits", "event"]


def test_truths_of_a_mode_are_bars_while_they_hold():
    """One leaf of two, of which the second holds until 1."""
    mode = {"on": jnp.array([False, True])}
    motion = switched_once({"on": True})
    motion.events.mode["on"] = jnp.array([[False, False]])
    motion.again.initial_mode = lambda: mode
    panel = hs.plot_solution(motion).axes[1]
    assert [label.get_text() for label in panel.get_yticklabels()] == ["mode.on[0]", "mode.on[1]"]
    off, on = (bars.get_paths() for bars in panel.collections)
    assert not off and on[0].vertices[:, 0].min() == 0 and on[0].vertices[:, 0].max() == 1
    assert _labels(motion, ["mode.on"]) == _labels(motion, ["mode.on[0]", "mode.on[1]"]) == ["mode", "event"]


def test_events_that_did_not_come_have_a_row_where_they_have_names():
    motion = switched_once({"on": True})
    motion = dataclasses.replace(motion, events=dataclasses.replace(motion.events, names=("here", "never")))
    assert [label.get_text() for label in hs.plot_solution(motion).axes[-1].get_yticklabels()] == ["here", "never"]


@pytest.mark.parametrize(
    ("ts", "end", "drawn"),
    [
        ([0.0, 2.0], 2.0, [(0.0, 3), (1.0, 4), (2.0, 4)]),
        ([0.2, 0.4], 2.0, [(0.2, 3), (0.4, 3)]),
        ([1.5], 2.0, [(1.5, 4), (1.5, 4)]),
        ([0.0, 2.0], 1.2, [(0.0, 3), (1.0, 4), (1.2, 4)]),
    ],
    ids=["the whole", "before the event", "after it", "broken off"],
)
def test_a_mode_is_drawn_from_the_first_sample_to_the_last(ts, end, drawn):
    """It is what the motion is in then, also where the samples do not span the motion, or the motion broke off."""
    motion = switched_once({"visits": 3}, ts, end)
    state, mode, _ = hs.plot_solution(motion).axes
    assert mode.lines[0].get_xydata().tolist() == [list(point) for point in drawn]
    times = state.lines[0].get_xdata()
    assert (times.min(), times.max()) == (ts[0], ts[-1])


def switched_once(mode, ts=(0.0, 1.0, 2.0), end=2.0):
    """A motion at rest whose mode changes at 1: written down, not simulated."""
    ts, again = jnp.array(ts), types.SimpleNamespace(initial_mode=lambda: mode)
    later = {name: jnp.asarray([value + 1]) for name, value in mode.items()}
    later = {name: value if name != "on" else jnp.array([False]) for name, value in later.items()}
    rest = jnp.zeros(1)
    events = SolutionEvents(jnp.ones(1), jnp.zeros(1, int), rest, rest, later, jnp.array(1))
    steps = Steps(jnp.array(1), jnp.array(0))
    ended = hs.Status.successful, jnp.array(end), jnp.array(jnp.nan), steps
    return hs.Solution(ts, 0 * ts, rest[0], None, events, mode, *ended, jnp.zeros(1, bool), again)


def _labels(motion, leaves=None):
    return [panel.get_ylabel() for panel in hs.plot_solution(motion, leaves).axes]


def test_leaves_are_chosen_by_their_names():
    """Those of the state in the order given, before those of the mode; a name that there is not is told."""
    motion = switched_once({"on": True, "visits": 99})
    assert _labels(motion) == ["x", "mode.on", "mode.visits", "event"]
    assert _labels(motion, ["mode.visits", "x"]) == ["x", "mode.visits", "event"]
    assert _labels(motion, []) == ["event"]
    with pytest.raises(ValueError, match="names among x, mode.on, .*but has mode.of.* Did you mean 'mode.on'"):
        hs.plot_solution(motion, ["x", "mode.of"])


def test_a_motion_without_an_event_is_drawn():
    """As one looks at where a guard never falls."""
    room = hs.systems.Thermostat()
    motion = hs.solve(room, room.initial_state(), room.initial_mode(), t1=0.01, ts=jnp.linspace(0.0, 0.01, 3))
    assert int(motion.events.count) == 0
    assert _labels(motion)[-1] == "no event"


def test_the_places_of_a_queue_are_not_drawn():
    """They are the book-keeping of what is still to come."""
    motion = switched_once({"on": True})
    mode = {"on": True, "queue": hs.DelayQueue.empty(1)}
    motion.events.mode["queue"] = jax.tree.map(lambda leaf: leaf[None], mode["queue"])
    motion.again.initial_mode = lambda: mode
    assert _labels(motion) == ["x", "mode.on", "event"]
