"""Fits that end on a bound, and guesses that begin there, against closed forms of straight lines."""

import numpy as np
import pytest

from hybridsens.estimation import fit, measurements
from tests.problems.sawtooth import Sawtooth

TIMES = np.linspace(0.03, 0.24, 8)
SIGMA = 0.01
VALUES = 1 - 2 * TIMES + SIGMA * np.random.default_rng(0).normal(size=TIMES.size)
SLOPE, TOP = -np.polyfit(TIMES, VALUES, 1) * [1, -1]


def _fit(guess, bounds, sigma=SIGMA):
    return fit(Sawtooth(*guess), measurements(TIMES, VALUES, sigma=sigma, names=["x"]), bounds=bounds)


@pytest.mark.parametrize("sigma", [SIGMA, None])
@pytest.mark.parametrize(
    ("bound", "end"), [((1.0, 1.5), 1.5), ((None, 1.5), 1.5), ((2.5, 3.0), 2.5), ((2.5, None), 2.5)]
)
def test_a_parameter_on_its_bound_is_named_and_the_other_is_known_as_if_it_were_held(bound, end, sigma):
    """Assert that a line whose slope ends on a bound, on either side, is a converged fit with the top mean(y + slope t)
    and its error sigma / sqrt(n), where n - 1 residuals tell sigma if it is not given."""
    result = _fit([1.3 if end < 2 else 2.8, 1.1], {"slope": bound}, sigma)
    top = np.mean(VALUES + end * TIMES)
    spread = sigma or np.std(VALUES + end * TIMES, ddof=1)
    np.testing.assert_allclose(result.values, [end, top], rtol=1e-5)
    np.testing.assert_allclose(result.standard_errors["top"], spread / np.sqrt(TIMES.size), rtol=1e-4)
    assert result.on_bound == ("slope",) and result.converged and result.uncertainty.freedom == TIMES.size - 1
    assert np.isnan(result.intervals()["slope"]).all() and np.isnan(result.correlation[0]).all()
    assert "on its bound: slope" in str(result) and "GrowingHorizon" not in str(result)


@pytest.mark.parametrize(
    ("bound", "guess"),
    [((1, 3), 1.5), ((1, None), 1.5), ((None, 3), 1.5), ((SLOPE - 2e-4, 3), 2.5), ((None, SLOPE + 2e-4), 1.5)],
)
def test_a_parameter_inside_its_bounds_is_not_held(bound, guess):
    """Assert the straight line of least squares, its slope with the textbook error, where bounds do not matter, also
    next to one: at a hundredth of its error."""
    result = _fit([guess, 1.1], {"slope": bound})
    error = SIGMA / np.sqrt(np.sum((TIMES - TIMES.mean()) ** 2))
    np.testing.assert_allclose(result.values, [SLOPE, TOP], rtol=1e-4)
    np.testing.assert_allclose(result.standard_errors["slope"], error, rtol=1e-6)
    assert result.on_bound == () and result.converged


def test_a_fit_whose_parameters_all_are_on_bounds_has_no_interval():
    """Assert that it is converged all the same, and can be printed."""
    result = _fit([2.8, 0.8], {"slope": (2.5, 3.0), "top": (None, 0.9)})
    np.testing.assert_allclose(result.values, [2.5, 0.9], rtol=1e-5)
    assert result.on_bound == ("slope", "top") and result.converged and str(result).count("[nan, nan]") == 2


@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-9])
@pytest.mark.parametrize("bound", [(1.0, 3.0), (1.0, None)])
def test_a_guess_on_its_bound_leaves_it(distance, bound):
    """Assert that a slope which begins on a bound comes to the minimum inside."""
    result = _fit([1.0 + distance, 1.1], {"slope": bound})
    np.testing.assert_allclose(result.values, [SLOPE, TOP], rtol=1e-4)
    assert result.converged and result.guess[0] == pytest.approx(1.0, abs=1e-5)


def test_a_fit_goes_on_from_where_one_ended_on_a_bound():
    """Assert that the fitted scene, whose slope is on its bound, is a guess for the same bounds."""
    first = _fit([1.3, 1.1], {"slope": (1.0, 1.5)})
    again = fit(first.scene, first.data, bounds={"slope": (1.0, 1.5)})
    np.testing.assert_allclose(again.values, first.values, rtol=1e-5)
    assert again.on_bound == ("slope",) and again.converged
