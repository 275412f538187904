"""Fits from guesses far off, by other optimizers, and after an interruption: all end at the minimum of a near fit."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.adjoint.methods import Replay
from hybridsens.estimation import GrowingHorizon, fit, measurements, prepare
from hybridsens.estimation.horizon import Stage
from hybridsens.estimation.problem import predict
from hybridsens.scenes import BouncingBall, ElasticStop
from tests.problems.stop_record import FAR, NEAR, STOP, TRUTH


@pytest.mark.slow
def test_a_growing_horizon_comes_home_from_a_guess_that_loses_the_phase(record, near):
    """Assert that a guess 30 % off ends at the same minimum by growing, in 15 iterations, notices new impacts, and
    directly ends elsewhere."""
    grown = fit(ElasticStop(**FAR), record, strategy=GrowingHorizon(), **STOP)
    np.testing.assert_allclose(grown.values, near.values, rtol=1e-3)
    assert grown.converged and grown.iterations <= 15
    assert grown.sequence_changes >= 1 and len(grown.sequence_start) != len(grown.sequence_end) == 5
    assert fit(ElasticStop(**FAR), record, max_iterations=30, **STOP).loss > 10 * grown.loss


@pytest.mark.slow
def test_a_grown_fit_that_was_cut_short_goes_on_without_stages(record, near):
    """Assert that the plain optimizer goes on from a result with room for two iterations of the whole problem."""
    short = fit(ElasticStop(**FAR), record, strategy=GrowingHorizon(), max_iterations=2, **STOP)
    assert short.stopped == "max_iterations"
    rest = fit(short.scene, record, **STOP)
    np.testing.assert_allclose(rest.values, near.values, rtol=1e-3)
    assert rest.converged and {line.stage for line in rest.history} == {"full"}


@pytest.mark.slow
def test_a_horizon_reaches_to_where_the_motion_leaves_the_record():
    """Assert that a record that leaves the motion after sample 11 is followed until there, that one wild sample is
    passed over, that the least reach holds, and that a true record is followed to its end."""
    times = np.linspace(0.05, 1.0, 20)
    ball = BouncingBall(restitution_coefficient=0.5)
    heights = np.where(times < np.sqrt(2 / 9.81), 1 - 9.81 * times**2 / 2, _after_first_impact(times))
    wild = heights + 50.0 * (np.arange(20) == 5)
    gone = np.where(np.arange(20) > 11, heights + 3 * np.std(heights), heights)
    growing, unknowns = GrowingHorizon(), prepare.Unknowns("restitution_coefficient")

    def reach(values, before=-np.inf):
        problem = prepare.build_problem(ball, measurements(times, values), unknowns)
        return float(growing.next(problem, predict(problem, jnp.ones(1))[1], jnp.asarray(before)))

    assert reach(heights) == reach(wild) == np.inf
    assert reach(gone) == times[11] and reach(gone, before=0.8) == pytest.approx(0.8 * 1.1)


@pytest.mark.slow
def test_a_stage_compares_and_counts_only_what_comes_before_its_end():
    """Assert that a stage which begins runs one motion to the end of the record, chooses sample 11 where they part,
    and leaves out residuals, impacts and measured impacts after it (the second impact is at 0.90 s, its end at 0.6)."""
    times = np.linspace(0.05, 1.0, 20)
    parted = np.where(np.arange(20) > 11, 5.0, np.where(times < np.sqrt(2 / 9.81), 1 - 9.81 * times**2 / 2,
                                                        _after_first_impact(times)))  # fmt: skip
    data = measurements(times, parted, sigma=1.0, event_times=[np.sqrt(2 / 9.81), 0.8], event_sigma=1.0)
    ball = BouncingBall(restitution_coefficient=0.5)
    problem = prepare.build_problem(ball, data, prepare.Unknowns("restitution_coefficient"))
    z = problem.selection.from_values(np.array([0.5]))
    stage = Stage(GrowingHorizon(), z, jnp.asarray(-np.inf), jnp.array(True))
    begins = eqx.tree_at(lambda p: p.stage, problem, stage, is_leaf=lambda leaf: leaf is None)
    r, trial = begins.residuals(z, Replay())
    assert trial.end == times[11] and int(np.sum(trial.kind >= 0)) == 1 and not trial.failed
    np.testing.assert_allclose(r, 0, atol=1e-7)
    begun, there = begins.at_stage_end(trial.end).residuals(z, Replay())
    np.testing.assert_allclose(begun, r, atol=1e-7)
    np.testing.assert_array_equal(there.kind, trial.kind)
    assert np.sum(np.abs(problem.residuals(z, Replay())[0]) > 0.05) == 9


def _after_first_impact(times):
    """Height of a ball dropped from 1 m after its first impact, e = 0.5, before its third."""
    fall, rebound = np.sqrt(2 / 9.81), 0.5 * np.sqrt(2 * 9.81)
    since = times - fall
    first = rebound * since - 9.81 * since**2 / 2
    since = since - 2 * rebound / 9.81
    return np.where(since < 0, first, 0.5 * rebound * since - 9.81 * since**2 / 2)


@pytest.mark.parametrize(
    ("optimizer", "iterations", "excess"),
    [pytest.param("lbfgs", 60, 1e-6, marks=pytest.mark.slow), pytest.param("adam", 100, 1e-2, marks=pytest.mark.slow)],
)
def test_optax_optimizers_reach_the_minimum_of_levenberg_marquardt(record, near, optimizer, iterations, excess):
    """Assert that L-BFGS and Adam, on the adjoint's gradient, fall from a loss ten times as large to that minimum."""
    found = fit(ElasticStop(**NEAR), record, optimizer=optimizer, max_iterations=iterations, **STOP)
    assert found.history[0].loss > 10 * near.loss
    assert near.loss * (1 - 1e-6) <= found.loss < near.loss * (1 + excess)


class Killed(Exception):
    """What ends a process from outside."""


def test_a_killed_fit_goes_on_from_its_store(record, near, tmp_path):
    """Assert that the file of a fit killed at its fourth iteration holds its best values, and that a fit from a guess
    that leads elsewhere goes on from them and ends at the minimum."""
    path, best = tmp_path / "best.json", []

    def kill(line):
        best.append(line.loss)
        if line.stage == "full" and line.number == 4:
            raise Killed

    with pytest.raises(Killed):
        fit(ElasticStop(**NEAR), record, store=path, progress=kill, **STOP)
    resumed = fit(ElasticStop(**FAR), record, store=path, **STOP)
    np.testing.assert_allclose(resumed.history[0].loss, min(best), rtol=1e-9)
    np.testing.assert_allclose(resumed.values, near.values, rtol=1e-3)
    with pytest.raises(ValueError, match="`store` must be of the same parameters"):
        fit(ElasticStop(**NEAR), record, store=path, parameters=["distance"])


def test_outliers_and_gaps_do_not_move_a_robust_fit(record, near):
    """Assert that with the four outliers in place a robust fit stays within 3 standard errors of the truth, and a plain
    one leaves it or has residuals several times the noise."""
    truth = np.array(list(TRUTH.values()))
    errors = lambda result: np.abs(result.values - truth) / result.uncertainty.standard_errors
    assert np.sum(np.isnan(record.values)) == 18 and np.all(errors(near) < 3)
    plain = fit(ElasticStop(**NEAR), record, **{**STOP, "robust": None})
    assert plain.uncertainty.noise > 2 * near.uncertainty.noise
    assert np.mean(errors(plain)) > np.mean(errors(near))
