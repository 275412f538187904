"""The settings of a simulation are one thing that every study takes."""

import inspect
import warnings

import diffrax
import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.scenes import BouncingBall
from hybridsens.settings import chosen_settings, given_numbers
from tests.closeness import assert_close
from tests.problems.balls import RestlessBall

TOLERANCES = [(1e-5, 1e-11), (1e-8, 1e-14)]
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


@pytest.mark.parametrize("kind", ["adjoint", "solver"])
def test_a_class_in_the_place_of_an_instance_is_told(kind, unchecked):
    given = {kind: dict(adjoint=hs.Replay, solver=diffrax.Tsit5)[kind]}
    with pytest.raises(TypeError, match=r"but is the class (Replay|Tsit5) itself: make one of it"):
        hs.simulate(BouncingBall(), BouncingBall().initial_state(), t1=1.0, **given)


@pytest.mark.slow
def test_a_traced_tolerance_is_raised_to_what_single_precision_can_do():
    """One that is not positive is refused all the same."""
    scene, start = RestlessBall(*jnp.float32([9.81, 0.8])), hs.State(jnp.float32([1.0]), jnp.float32([0.0]))

    @jax.jit
    def tried(rtol):
        motion = hs.simulate(scene, start, t1=1.0, rtol=rtol, atol=rtol, max_events=4, max_steps=2000, throw=False)
        return motion.steps.accepted + motion.steps.rejected, motion.status

    assert tried(1e-12)[0] == tried(16 * jnp.finfo(jnp.float32).eps)[0]
    assert tried(-1.0)[1] == hs.Status.bad_tolerance


def test_only_single_precision_is_sent_to_double():
    with pytest.warns(UserWarning, match="beyond float64 and is raised to it.$"):
        given_numbers(1e-20, 1e-8, None, 0.0, jnp.dtype("float64"), ())


@pytest.mark.parametrize("given", [float, jnp.asarray], ids=["numbers", "arrays"])
def test_single_precision_keeps_the_size_below_which_a_state_does_not_count(given):
    """atol / rtol, in the units of the state: a neuron in microvolts had 57 spikes for 9 without."""
    finest, single = 16 * float(jnp.finfo(jnp.float32).eps), jnp.dtype("float32")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        kept, raised = (given_numbers(given(r), given(a), None, 0.0, single, ())[:2] for r, a in TOLERANCES)
    assert_close(jnp.stack([*map(jnp.asarray, kept)]), jnp.array([1e-5, 1e-11]), 1e-6)
    assert_close(jnp.stack([*map(jnp.asarray, raised)]), jnp.array([finest, finest * 1e-6]), 1e-6)
