"""Fits against records that another integrator made, and against closed forms."""

from importlib import import_module

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens import load
from hybridsens.estimation import RandomStarts, fit, measurements
from hybridsens.estimation.descend import GuessFailed
from hybridsens.scenes import BouncingBall, ElasticStop
from tests.problems.stop_record import NEAR, STOP, TRUTH


def _impact_times(height, e, g, count):
    """Times at which a ball dropped from `height` hits the floor."""
    first = np.sqrt(2 * height / g)
    return first * np.array([1 + 2 * sum(e**k for k in range(1, n + 1)) for n in range(count)])


def test_six_parameters_are_recovered_in_few_iterations(near):
    """Assert that Levenberg-Marquardt finds the truth of SciPy's record within 3 standard errors and 15 iterations."""
    assert near.converged and near.iterations <= 15
    for name, value in zip(near.labels, near.values, strict=True):
        assert abs(value - TRUTH[name]) < 3 * near.standard_errors[name] < 0.1, name
    assert [event[0] for event in near.sequence_end] == ["impact"] * 5


def test_what_is_printed_names_the_parameters_and_events(near):
    """Assert that the report shows values, events and the end of the run."""
    text = str(near)
    assert "converged" in text and "restitution_coefficient" in text and "events at the guess:" in text
    assert "5 (5 x impact 0)" in text


def test_what_is_printed_has_the_names_of_contacts(near):
    """Assert that events of a scene which names its contacts are told by these names."""

    class Named(ElasticStop):
        contacts = ("fence",)

    assert "5 (5 x impact fence)" in str(eqx.tree_at(lambda fitted: fitted.scene, near, Named()))


def test_a_file_holds_the_fit_as_a_data_set(near, tmp_path):
    """Assert that what `save` writes and `load` reads has the numbers of the result, by name, and that a notebook shows
    the report."""
    near.save(tmp_path / "fit.nc")
    dataset = load(tmp_path / "fit.nc")
    low, high = near.intervals()["distance"]
    np.testing.assert_array_equal(dataset.value.sel(parameter="distance"), near.values[near.labels.index("distance")])
    np.testing.assert_array_equal([dataset[name].sel(parameter="distance") for name in ("low", "high")], [low, high])
    np.testing.assert_array_equal(dataset.residual, near.residuals)
    assert dataset.attrs["stopped"] == "converged" and dataset.loss.size == len(near.history)
    assert "95 % interval" in near._repr_html_()


def test_a_fit_goes_on_from_an_earlier_one(record, near):
    """Assert that a fit stopped by its callback, and gone on from, ends where the uninterrupted one ends."""
    first = fit(ElasticStop(**NEAR), record, progress=lambda line: line.number >= 2, **STOP)
    assert first.stopped == "stopped by the callback" and first.loss > near.loss
    second = fit(first.scene, record, **STOP)
    np.testing.assert_allclose(second.values, near.values, rtol=1e-4)


@pytest.mark.parametrize("optimizer", ["levenberg-marquardt", "gauss-newton", "adam", "lbfgs"])
def test_iterations_are_of_one_program(record, optimizer, monkeypatch):
    """Assert that what one call of the iterations hands to the next has the types that it was given, weak or not."""

    class Met(Exception):
        pass

    def types(method, problem, carry, limit, room):
        given = eqx.filter(carry, eqx.is_array)
        done = eqx.filter_eval_shape(run, method, problem, carry, limit, room)[0]
        of = lambda tree: [(leaf.dtype, leaf.shape, leaf.weak_type) for leaf in jax.tree.leaves(tree)]
        assert of(given) == of(eqx.filter(done, lambda leaf: isinstance(leaf, jax.ShapeDtypeStruct)))
        raise Met

    module = import_module("hybridsens.estimation.iterate")
    run = module._iterate
    monkeypatch.setattr(module, "_iterate", types)
    with pytest.raises(Met):
        fit(ElasticStop(**NEAR), record, optimizer=optimizer, **STOP)


def test_an_interrupted_fit_keeps_its_best_point(record):
    """Assert that Ctrl-C ends a fit with the best point found so far."""

    def interrupt(line):
        if line.number == 3:
            raise KeyboardInterrupt

    result = fit(ElasticStop(**NEAR), record, progress=interrupt, **STOP)
    assert result.stopped == "interrupted" and result.interrupted
    assert result.loss == min(line.loss for line in result.history) < result.history[0].loss


def test_an_interruption_after_the_last_iteration_loses_nothing(record, near, monkeypatch):
    """Assert that Ctrl-C while intervals are computed is let pass once, and that a second one ends the fit."""
    module, asked = import_module("hybridsens.estimation.fit"), []
    build = module.build_result

    def interrupted(*given):
        asked.append(given)
        if len(asked) == 1:
            raise KeyboardInterrupt
        return build(*given)

    monkeypatch.setattr(module, "build_result", interrupted)
    result = fit(near.scene, record, **STOP)
    assert len(asked) == 2 and result.stopped == near.stopped and result.standard_errors
    monkeypatch.setattr(module, "build_result", lambda *given: asked.clear() or interrupted(*given))
    with pytest.raises(KeyboardInterrupt):
        fit(near.scene, record, **STOP)


@pytest.mark.slow
def test_event_times_alone_give_height_and_restitution():
    """Assert that exact impact times of a dropped ball give its height and restitution, and dt/d(height) = t / (2
    height)."""
    height, e, g = 1.3, 0.7, 9.81
    times = _impact_times(height, e, g, 4)
    data = measurements(event_times=times, event_sigma=1e-3)
    guess = BouncingBall(height=1.1, restitution_coefficient=0.6, weight=g)
    result = fit(guess, data, parameters=["height", "restitution_coefficient"], t1=2.5,
                 bounds={"height": "positive", "restitution_coefficient": (0, 1)})  # fmt: skip
    np.testing.assert_allclose(result.values, [height, e], rtol=1e-6)
    np.testing.assert_allclose(result.jacobian[:, 0] * 1e-3, times / (2 * height), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("lost", [None, 1, 3])
def test_an_impact_that_was_not_seen_keeps_its_number(lost):
    """Assert that of four impacts one may be missing, the last one too."""
    height, e, g = 1.3, 0.7, 9.81
    times = _impact_times(height, e, g, 4)
    times[slice(0) if lost is None else lost] = np.nan
    data = measurements(event_times=times, event_sigma=1e-3, missing="skip")
    guess = BouncingBall(height=1.5, restitution_coefficient=0.72, weight=g)
    result = fit(guess, data, parameters=["height", "restitution_coefficient"])
    np.testing.assert_allclose(result.values, [height, e], rtol=1e-6)
    np.testing.assert_array_equal(np.isnan(result.event_residuals), np.isnan(times))


@pytest.mark.slow
def test_an_impact_later_than_the_last_measured_one_is_compared_with_it():
    """Assert that motions go on for long enough by themselves: were the guess's only impact cut off, nothing would be
    left that depends on the height."""
    times = _impact_times(1.3, 0.7, 9.81, 1)
    data = measurements(event_times=times, event_sigma=1e-3)
    result = fit(BouncingBall(height=1.5, weight=9.81), data, parameters=["height"])
    np.testing.assert_allclose(result.values, [1.3], rtol=1e-6)


@pytest.mark.slow
def test_a_measured_impact_that_the_motion_lacks_is_named():
    """Assert that a second impact at a time when no ball of that height can have one is reported as missing."""
    data = measurements(event_times=[_impact_times(1.0, 0.5, 9.81, 1)[0], 0.6], event_sigma=1e-3)
    result = fit(BouncingBall(height=1.0, restitution_coefficient=0.5), data, parameters=["height"], t1=0.7)
    np.testing.assert_array_equal(result.events_missing, [1])
    text = str(result)
    assert text.startswith("fit converged, but lacks a measured event, after") and not result.converged
    assert "measured event 1 (at 0.6 s) is not in the fitted motion" in text


@pytest.mark.slow
def test_residuals_that_are_no_noise_are_named():
    """Assert that a ball with drag, fitted without, is reported: neighbouring residuals are alike, and they are larger
    than their sigmas; the report of a model that is right says neither."""
    times = np.linspace(0.01, 0.4, 40)
    drop = 1.0 - np.log(np.cosh(times * np.sqrt(9.81 * 0.5))) / 0.5  # q'' = -9.81 + 0.5 q'^2 from rest
    without = fit(BouncingBall(), measurements(times, drop, sigma=1e-3), parameters=["height"])
    assert without.residual_correlation["q0"] > 0.8
    assert "alike from sample to sample" in str(without) and "as large as their sigmas" in str(without)
    noisy = 1.0 - 9.81 * times**2 / 2 + 1e-3 * np.random.default_rng(1).normal(size=40)
    right = fit(BouncingBall(), measurements(times, noisy, sigma=1e-3), parameters=["height"])
    assert "alike" not in str(right) and "as large as" not in str(right)
    exact = fit(BouncingBall(), measurements(times, 1.0 - 9.81 * times**2 / 2), parameters=["height"])
    assert "alike" not in str(exact)


@pytest.mark.slow
def test_masses_that_no_motion_shows_are_named():
    """Assert that any function of the state can be observed, and that of a ball's mass and weight only the ratio is
    seen:
    it is 9.81 by the closed form, and the null direction in relative change is (1, 1) / sqrt 2."""
    times = np.linspace(0.05, 0.4, 8)
    data = {"t": times, "speed": 9.81 * times, "height": 1.0 - 9.81 * times**2 / 2}
    see = lambda scene, t, q, v: {"height": q[0], "speed": -v[0]}
    result = fit(BouncingBall(weight=9.0), data, parameters=["mass", "weight"], observe=see)
    assert abs(result.values[1] / result.values[0] - 9.81) < 1e-6
    assert len(result.uncertainty.null_directions) == 1 and "not determined by the data" in str(result)
    (direction,) = result.uncertainty.null_directions
    assert abs(direction["mass"] - direction["weight"]) < 1e-6


@pytest.mark.slow
def test_trial_points_that_fail_are_never_taken():
    """Assert that steps to an impossible restitution are rejected, counted and explained, and the best point has a
    motion."""
    times = _impact_times(1.0, 0.99, 9.81, 3)
    data = measurements(event_times=times + np.array([0.0, 0.01, 0.05]), event_sigma=1e-3)
    result = fit(BouncingBall(restitution_coefficient=0.9), data, parameters=["restitution_coefficient"], t1=3.0,
                 max_iterations=15)  # fmt: skip
    failed = [line for line in result.history if line.failure]
    assert failed and all(not line.accepted for line in failed) and result.failures == len(failed)
    assert "restitution must lie in [0, 1]" in failed[0].failure and "rejected" in str(result)
    assert 0.9 < result.values[0] <= 1 and np.isfinite(result.loss)


def test_a_guess_without_a_motion_is_refused(record):
    """Assert that a guess with a negative mass is an error that says so."""
    with pytest.raises(GuessFailed, match="mass matrix must be symmetric positive definite"):
        fit(ElasticStop(mass=-1.0, **NEAR), record, **STOP)


def test_times_outside_the_horizon_and_unknown_columns_are_refused():
    """Assert that both are named before anything is compiled."""
    with pytest.raises(ValueError, match="must lie in the horizon"):
        fit(BouncingBall(), measurements([0.1, 2.0], [1.0, 1.0]), t1=1.0)
    with pytest.raises(ValueError, match="columns must be named after the state .q0, v0."):
        fit(BouncingBall(), measurements([0.1], [1.0], names=["width"]))


def test_a_robust_fit_needs_sigmas():
    """Assert that a limit in sigmas is refused where there are none: in the data's unit it would do nothing."""
    with pytest.raises(ValueError, match="`robust` counts in sigmas"):
        fit(BouncingBall(), measurements([0.1], [1.0]), robust=2.0)


@pytest.mark.slow
def test_many_starts_agree_with_one(record, near):
    """Assert that the best of 4 starts in one compiled run is the minimum that a single good start finds."""
    several = fit(ElasticStop(**NEAR), record, starts=RandomStarts(4, spread=0.05), **STOP)
    np.testing.assert_allclose(several.values, near.values, rtol=1e-3)
    assert several.starts is not None and several.starts.z.shape == (4, 6)
    assert float(jnp.min(several.starts.loss)) <= near.loss * (1 + 1e-6)
