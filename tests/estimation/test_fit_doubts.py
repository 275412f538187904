"""What a fit must not be certain of: exact data, and parameters that nothing measured depends on."""

import functools
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.estimation import fit, measurements
from hybridsens.estimation.doubts import doubts
from hybridsens.estimation.report import remarks
from hybridsens.estimation.result import FitResult
from hybridsens.estimation.uncertainty import Noise, neighbour_correlation, uncertainty
from hybridsens.scenes import BouncingBall
from hybridsens.solve import solve
from tests.problems.hybrid_systems import Decay

one_large_program = pytest.mark.slow
"""Most of these need the same large program."""

TIMES = np.linspace(0.05, 0.4, 20)
FALL = 1.0 - 9.81 * TIMES**2 / 2
NOISE = np.random.default_rng(3).normal(size=TIMES.size)


class Falling(BouncingBall):
    """Its mass cancels, but for rounding; and before it lands, its restitution does not act."""

    def force(self, t, q, v):
        del t, q, v
        return -(self.mass * 9.81)[None]


@functools.cache
def _fitted(noise, sigma=None):
    data = measurements(TIMES, FALL + noise * NOISE, sigma=sigma)
    return fit(Falling(height=1.1), data, parameters=["mass", "restitution_coefficient", "height"],
               priors={"mass": (1.0, 0.1)} if sigma else None)  # fmt: skip


@one_large_program
def test_exact_data_give_no_certainty():
    """Assert that without sigmas a ball's exact fall yields its height, no interval, and a sentence that says why."""
    exact = _fitted(0.0)
    np.testing.assert_allclose(exact.values[2], 1.0, rtol=1e-7)
    assert exact.uncertainty.exact and np.isnan(exact.intervals()["height"]).all()
    assert "residuals are zero to rounding" in str(exact) and "give `sigma`" in str(exact)


@one_large_program
def test_exact_data_with_sigmas_are_known_as_well_as_these_say():
    """Assert that the error of a height is then sigma / sqrt(n)."""
    known = _fitted(0.0, 1e-3)
    assert not known.uncertainty.exact and "zero to rounding" not in str(known)
    np.testing.assert_allclose(known.standard_errors["height"], 1e-3 / np.sqrt(TIMES.size), rtol=1e-6)


@one_large_program
def test_small_noise_is_noise():
    """Assert that noise of a millionth of the data's range gives an interval: that of a mean, whatever else is fitted
    without being seen."""
    result = _fitted(1e-6)
    expected = 1e-6 * np.sqrt(np.sum((NOISE - NOISE.mean()) ** 2) / (NOISE.size - 1) / NOISE.size)
    assert not result.uncertainty.exact
    np.testing.assert_allclose(result.standard_errors["height"], expected, rtol=1e-2)


@one_large_program
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_parameters_without_influence_are_named(noise):
    """Assert that a mass that cancels and a restitution that never acts are told by name, without finite interval."""
    result = _fitted(noise)
    assert result.uncertainty.unseen == ("mass", "restitution_coefficient")
    assert result.uncertainty.null_directions == []
    for name in result.uncertainty.unseen:
        assert result.intervals()[name] == (-np.inf, np.inf)
        assert f"not determined by the data: {name}, since nothing that was measured depends on it" in str(result)


@one_large_program
def test_a_prior_tells_of_a_parameter_without_influence():
    """Assert that a mass that nothing shows has its prior's error, and is named all the same."""
    result = _fitted(0.0, 1e-3)
    np.testing.assert_allclose(result.standard_errors["mass"], 0.1, rtol=1e-6)
    assert "mass" in result.uncertainty.unseen


def test_a_derivative_of_rounding_alone_is_none():
    """Assert that a single parameter whose Jacobian is rounding has no finite error, with sigmas or without."""
    for sigmas_given in (True, False):
        known = uncertainty(("mass",), [1.0], 1e-3 * NOISE, 1e-17 * np.ones((NOISE.size, 1)), np.zeros(1),
                            Noise(sigmas_given, largest=1.0, rounding=1e-7))  # fmt: skip
        assert known.unseen == ("mass",) and np.isinf(known.standard_errors).all()


class Refilled(Decay):
    """x decays, and gains 1/2 where it falls through 0.3."""

    def guards(self, t, x, mode):
        return (x - 0.3)[None]

    def transition(self, event, t, x, mode):
        return x + 0.5, mode


@pytest.mark.slow
def test_a_jump_of_the_loss_is_no_minimum():
    """Just below k = 1.317 an event passes the time of a measurement: the loss falls towards it and jumps there."""
    times = np.linspace(0.1, 2.0, 8)
    values = np.asarray(solve(Refilled(1.0), 1.0, t1=2.0, ts=jnp.array(times)).x)
    data = measurements(times, values, sigma=0.01, names=["x"])
    result = fit(Refilled(1.2), data, parameters="k", state=1.0, max_events=8, observe=lambda system, t, x: {"x": x})
    assert not result.converged
    assert 1.31 < result.values[0] < 1.317
    assert "begin on the other side" in str(result)


@one_large_program
def test_a_few_wild_values_are_told():
    """Assert that their rows are named, and nothing of the sort for a record without such."""
    wild = FALL + 1e-3 * NOISE
    wild[[3, 11]] += 0.2
    found = remarks(fit(Falling(height=1.1), measurements(TIMES, wild), parameters=["height"]))
    assert any("of q0 are more than 7 times as large as most others at rows 3, 11" in remark for remark in found)
    assert any("give `sigma` and `robust=3`; they widen all intervals" in remark for remark in found)
    assert not any("most others" in remark for remark in _fitted(1e-6).remarks)


def _told(residuals, noise, stopped="converged"):
    """What is said of a fit with sigmas."""
    result = SimpleNamespace(
        uncertainty=SimpleNamespace(exact=False, noise=noise, freedom=17, quantile_freedom=np.inf),
        data=SimpleNamespace(names=("q",), values=FALL[:, None], sigmas=None, sigmas_known=True),
        residuals=residuals[:, None], scene=None, events_missing=(), on_bound=(), stopped=stopped,
        residual_correlation={"q": neighbour_correlation(residuals)},
    )  # fmt: skip
    return list(doubts(result))


def test_wild_values_do_not_widen_intervals_that_sigmas_set():
    """Assert that the remark does not say so."""
    wild = np.where(TIMES == TIMES[3], 0.2, 1e-3 * NOISE)
    (found,) = [remark for remark in _told(wild, 1.0) if "most others" in remark]
    assert found.endswith("or give `robust=3`; they draw the estimates to them")


def test_a_correlation_is_at_most_one():
    """Assert that half a wave is alike, and no more."""
    assert 0.9 < neighbour_correlation(np.sin(np.linspace(0, np.pi, 10))) <= 1


def test_residuals_that_are_no_noise_may_tell_of_another_minimum():
    """Assert that the report says so where neighbours are alike or sigmas are exceeded, and not of noise; a fit that
    stopped before a minimum is told of by itself."""

    def found(*given):
        words = ("not the lowest minimum", "it did not converge, and standard errors")
        return [remark for remark in _told(*given) if any(word in remark for word in words)]

    assert not found(0.01 * NOISE, 1.0)
    assert len(found(0.01 * NOISE, 1.0, "stalled")) == 1
    assert len(found(0.01 * NOISE, 3.0)) == len(found(0.01 * np.cos(TIMES), 1.0)) == 1


@pytest.mark.parametrize(("unseen", "converged"), [((), True), (("mass",), True), (("mass", "height"), False)])
def test_a_fit_of_what_nothing_measured_depends_on_has_not_converged(unseen, converged):
    """Its gradient is zero wherever it begins."""
    ended = SimpleNamespace(
        stopped="converged", events_missing=np.zeros(0), labels=("mass", "height"),
        uncertainty=SimpleNamespace(unseen=unseen),
    )  # fmt: skip
    assert FitResult.converged.fget(ended) is converged
