"""What `fit` says of arguments that cannot be meant, before it compiles anything."""

import json
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import numpy as np
import pytest

from hybridsens.estimation import GrowingHorizon, RandomStarts, fit, measurements, read_measurements
from hybridsens.estimation.fit import check_limits, check_robust, check_strategy, chosen_starts
from hybridsens.estimation.optimizers import chosen_method
from hybridsens.estimation.parameters import select
from hybridsens.estimation.prepare import Experiment, Unknowns, build_problem, prior
from hybridsens.estimation.store import Store, study_digest
from hybridsens.validation.arguments import by_name
from tests.problems.sawtooth import Sawtooth

GUESS = Sawtooth(2.0, 1.0)
RECORD = {"t": [0.1, 0.2], "x": [0.8, 0.6], "sigma_x": [0.1, 0.1]}
DATA = read_measurements(RECORD)


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ({"slope": 3.0}, r"bounds of 'slope' must be \"positive\" or a pair \(lo, hi\), .* but are 3.0"),
        ({"slope": (0, 1, 2)}, r"bounds of 'slope' must be .* a pair .* but are \(0, 1, 2\)"),
        ({"slope": ("a", 3.0)}, r"bounds of 'slope' must be numbers with lo < hi, but are \('a', 3.0\)"),
    ],
)
def test_bounds_that_are_no_pair_of_numbers_are_shown(bounds, message):
    """Assert that the message names the parameter and what was given."""
    with pytest.raises(ValueError, match=message):
        fit(GUESS, RECORD, bounds=bounds)


@pytest.mark.parametrize("given", [3.0, (1.0, "a"), (np.nan, 1.0), (1.0, 0.0)])
def test_a_prior_that_is_no_pair_of_numbers_is_shown(given):
    """Assert that the message names the parameter and what was given."""
    with pytest.raises(ValueError, match=r"prior of 'slope' must be a pair \(mean, sigma\)") as refused:
        prior(select(GUESS, "slope"), {"slope": given})
    assert f"but is {given}" in str(refused.value)


def test_priors_need_sigmas():
    """Assert that values of unknown sigma are not weighed against a prior, whose sigma is known: the estimate took
    theirs for 1, its interval for that of the residuals. Event times alone always have sigmas."""
    without = read_measurements({"t": RECORD["t"], "x": RECORD["x"]})
    with pytest.raises(ValueError, match="must have sigmas where priors are given.*give `sigma`"):
        fit(GUESS, without, parameters="slope", priors={"slope": (2.0, 0.1)})
    assert build_problem(GUESS, without, Unknowns("slope", priors={})).prior.weight[0] == 0
    for known in (DATA, measurements(event_times=[0.5], event_sigma=0.1)):
        problem = build_problem(GUESS, known, Unknowns("slope", priors={"slope": (2.0, 0.1)}))
        np.testing.assert_allclose(problem.prior.weight, 10)


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: by_name("bounds", (0, 1)), "`bounds` must be a mapping by names of parameters, but is tuple"),
        (lambda: chosen_method("adm"), "`optimizer` must be one of .* but is 'adm'. Did you mean 'adam'"),
        (lambda: chosen_starts(2.0), r"`starts`, if it is not RandomStarts.*, must be an integer >= 1, but is 2.0"),
        (lambda: chosen_starts(0), "`starts`.* must be an integer >= 1, but is 0"),
        (lambda: RandomStarts(count=0), "`count` must be an integer >= 1, but is 0"),
        (lambda: RandomStarts(spread=0.0), r"`spread` must lie inside \(0, 1\), but is 0.0"),
        (lambda: GrowingHorizon(steps=0), "`steps` must be an integer >= 1, but is 0"),
        (lambda: check_strategy(GrowingHorizon), r"`strategy` must be a GrowingHorizon\(\) or None, but is the class"),
        (lambda: check_strategy("growing"), r"`strategy` must be a GrowingHorizon\(\) or None, but is 'growing'"),
        (lambda: check_limits("3", 20), "`max_iterations` must be an integer >= 1, but is '3'"),
        (lambda: check_limits(100, 2.5), "`patience` must be an integer >= 1, but is 2.5"),
        (lambda: check_robust("a", DATA), "`robust` must be a positive number or None, but is 'a'"),
        (lambda: check_robust(np.nan, DATA), "`robust` must be a positive number or None, but is nan"),
    ],
)
def test_an_argument_that_cannot_be_meant_is_shown_with_what_it_must_be(check, message):
    """Assert that the message names the argument and shows what was given."""
    with pytest.raises((ValueError, TypeError), match=message):
        check()


@pytest.mark.parametrize("count", [3, np.int64(3), np.asarray(3)])
def test_a_number_of_starts_may_be_one_of_numpy(count):
    """Assert that it is a count as a Python integer is."""
    assert chosen_starts(count).count == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{slope:", "must be a JSON file, but .*best.json is none"),
        ("[1]", r"names and numbers that a fit wrote, but .*best.json has \[1\]"),
        ('{"slope": 1.0}', r"that a fit wrote, but .*best.json has \{'slope': 1.0\}"),
        ('{"values": {"slope": "a"}, "study": ""}', r"names and numbers .*best.json has \{'values': \{'slope': 'a'\}"),
        ('{"values": {"slope": true}, "study": ""}', r"and numbers .*best.json has \{'values': \{'slope': True\}"),
        ('{"values": {"top": 1.0}, "study": ""}', r"the same parameters \('slope',\), but .*best.json has \('top',\)"),
        ('{"values": {"slope": 1.0}, "study": ""}', "of the same study, but .*best.json is of other measurements"),
        ('{"values": {"slope": -1.0}, "study": "STUDY"}', r"within its bounds \[0.0, inf\], but is -1.0"),
        ('{"values": {"slope": NaN}, "study": "STUDY"}', "value in .*best.json of 'slope' must .* but is nan"),
    ],
)
def test_a_store_that_holds_no_values_is_named(text, message, tmp_path):
    """Assert that the file is named, and what it holds."""
    path = tmp_path / "best.json"
    path.write_text(text.replace("STUDY", _study()))
    with pytest.raises(ValueError, match=message) as refused:
        fit(GUESS, RECORD, parameters="slope", bounds={"slope": "positive"}, store=path)
    assert not isinstance(refused.value, json.JSONDecodeError)


def test_a_store_that_cannot_be_written_is_refused_at_once(tmp_path):
    """Assert that a folder, and a file in a folder that is not there, are named before the fit, not after it."""
    for path, message in ((tmp_path, "is a folder"), (tmp_path / "no" / "x.json", "a folder that does not exist")):
        with pytest.raises(ValueError, match=message):
            fit(GUESS, RECORD, parameters="slope", store=path)


def test_a_store_gives_back_what_it_was_given(tmp_path):
    """Assert that values on a bound, too, are read as they were written."""
    selection = select(GUESS, ["slope", "top"], {"slope": (1.0, 3.0)})
    store = Store(tmp_path / "best.json", selection, "this one")
    assert store.read() is None
    store.write(np.array([np.pi / 2, 0.5]))
    np.testing.assert_array_equal(store.read().values, [3.0, 0.5])
    with pytest.raises(ValueError, match="`store` must be of the same study"):
        store._replace(study="another").read()


def _study(guess=GUESS, data=DATA, bounds=None, state=None, t0=0.0):
    problem = build_problem(guess, data, Unknowns("slope", bounds), Experiment(state, t0=t0))
    return study_digest(problem, data)


class _OtherSawtooth(Sawtooth):
    """By another name."""


class _Bent(Sawtooth):
    """With a number that is static."""

    power: int = eqx.field(static=True, default=1)


@pytest.mark.parametrize(
    ("change", "same"),
    [
        (dict(), True),
        (dict(guess=Sawtooth(3.0, 1.0)), True),
        (dict(bounds={"slope": "positive"}), True),
        (dict(guess=Sawtooth(2.0, 1.5)), False),
        (dict(guess=_OtherSawtooth(2.0, 1.0)), False),
        (dict(data=read_measurements(RECORD | {"x": [0.8, 0.5]})), False),
        (dict(data=read_measurements(RECORD | {"sigma_x": [0.1, 0.2]})), False),
        (dict(data=read_measurements({"t": RECORD["t"], "x": RECORD["x"]})), False),
        (dict(state=1.0), False),
        (dict(t0=0.05), False),
    ],
)
def test_a_study_is_known_by_its_data_and_by_what_is_not_fitted(change, same):
    """Assert that a fit may go on from another guess or with bounds, but not with other measurements, another model,
    another fixed parameter or another beginning."""
    assert (_study(**change) == _study()) == same


def test_a_study_is_known_by_its_static_numbers():
    """Assert that a fit does not go on with another model of the same class: it ended in another minimum."""
    assert _study(guess=_Bent(2.0, 1.0)) == _study(guess=_Bent(3.0, 1.0, power=1))
    assert _study(guess=_Bent(2.0, 1.0)) != _study(guess=_Bent(2.0, 1.0, power=2))


class _Told(Sawtooth):
    """With a text, and a part of its own, neither of which is a number."""

    kind: str = "a"
    part: eqx.Module = _Bent(1.0, 1.0)


def test_a_study_is_known_by_its_texts_and_by_the_classes_of_its_parts():
    assert _study(guess=_Told(2.0, 1.0)) == _study(guess=_Told(3.0, 1.0))
    for other in (_Told(2.0, 1.0, kind="b"), _Told(2.0, 1.0, part=_OtherSawtooth(1.0, 1.0))):
        assert _study(guess=_Told(2.0, 1.0)) != _study(guess=other)


def test_a_fit_goes_on_without_a_store_that_cannot_be_written(tmp_path):
    """Assert that a folder that is gone is told of: the best point in memory was lost."""
    store = Store(tmp_path / "gone" / "best.json", select(GUESS, "slope"), "this one")
    with pytest.warns(UserWarning, match="best.json cannot be written .* The fit goes on"):
        store.write(np.array([1.0]))


@pytest.mark.slow
def test_the_store_of_another_record_is_refused(tmp_path):
    """Assert that a fit goes on with its own file alone."""
    path, kept = tmp_path / "best.json", dict(parameters="slope", max_events=4, max_steps=64)
    fit(Sawtooth(1.8, 1.0), RECORD, store=path, **kept)
    assert fit(GUESS, RECORD, store=path, **kept).converged
    with pytest.raises(ValueError, match="`store` must be of the same study, but .*best.json is of other measurements"):
        fit(GUESS, RECORD | {"x": [0.8, 0.5]}, store=path, **kept)


def test_two_fits_may_have_one_store(tmp_path):
    """Assert that neither takes away what the other is about to move: one of them ended by a FileNotFoundError."""
    store = Store(tmp_path / "best.json", select(GUESS, "slope"), "this one")
    with ThreadPoolExecutor() as both:
        list(both.map(lambda _: store.write(np.array([1.0])), range(200)))
    assert store.read() is not None and list(tmp_path.iterdir()) == [store.path]


@pytest.mark.slow
@pytest.mark.parametrize("starts", [1, 2])
def test_a_store_is_there_after_a_fit_that_had_nothing_to_do(starts, tmp_path):
    """Assert that a guess at the minimum, or the best of many starts, is kept: no file was written."""
    path = tmp_path / "best.json"
    fit(GUESS, RECORD, store=path, starts=starts, parameters="slope", max_events=4, max_steps=64)
    assert json.loads(path.read_text())["values"]["slope"] == pytest.approx(2.0)


@pytest.mark.parametrize("name", ["sigma", "event_times"])
def test_what_belongs_to_the_data_is_sent_there(name):
    told = rf"`fit` must be given {name} with the data, .*read_measurements\(table, {name}="
    with pytest.raises(TypeError, match=told):
        fit(GUESS, RECORD, **{name: 0.1})
