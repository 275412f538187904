"""The settings of a simulation are one thing that every study takes."""

import inspect

import pytest

import hybridsens as hs
from hybridsens.scenes import BouncingBall
from hybridsens.settings import chosen_settings

STUDIES = (hs.fit, hs.compare, hs.work_precision, hs.check_gradient)


def test_settings_are_arguments_of_simulate_and_solve():
    """Each has the name and the type that it has there; capture belongs to mechanics."""
    for run, names in ((hs.simulate, set()), (hs.solve, {"capture_speed"})):
        parameters = inspect.signature(run).parameters
        assert hs.Settings.__annotations__.keys() - names <= parameters.keys()
    assert hs.Settings.__annotations__ == {
        name: inspect.signature(hs.simulate).parameters[name].annotation for name in hs.Settings.__annotations__
    }


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.__name__)
def test_a_study_names_a_setting_that_it_does_not_know(study):
    """Before anything is run, with the name that was meant."""
    assert "settings" in inspect.signature(study).parameters
    data = [([0.1, 0.2], [0.9, 0.8])] if study is hs.fit else []
    with pytest.raises(TypeError, match=rf"`{study.__name__}` must have settings among .*Did you mean 'max_events'"):
        study(BouncingBall(), *data, max_event=3)


def test_what_is_given_replaces_what_a_study_would_take():
    """Alone: the others stay as they are."""
    own = dict(rtol=1e-12, max_steps=16384)
    assert chosen_settings("fit", dict(rtol=1e-6, max_events=9), own) == dict(rtol=1e-6, max_steps=16384, max_events=9)
