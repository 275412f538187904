"""Event times beside values, and alone."""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens import AbstractHybridSystem, AbstractScene, State
from hybridsens.estimation import fit, measurements
from hybridsens.estimation.prepare import Unknowns, build_problem, observations
from hybridsens.scenes import BouncingBall
from tests.problems.sawtooth import Sawtooth

SIGMA = 1e-3
COUNTS = np.arange(1, 5)


def _record(sigma=None):
    """Values until 0.4, of a motion with slope 2 and top 1, and four events; their errors add up to nothing."""
    times = np.linspace(0.05, 0.4, 8)
    errors = SIGMA * np.array([0.0, 1.0, -1.0, 0.5])
    return measurements(times, 1 - 2 * times, sigma=sigma, names=["x"], event_times=COUNTS / 2 + errors,
                        event_sigma=SIGMA)  # fmt: skip


def test_values_beside_event_times_need_sigmas():
    """Assert that values of unknown sigma are not weighed against event times, whose sigmas are known: intervals of
    such fits held the truth in none of 40 records."""
    with pytest.raises(ValueError, match="must have sigmas where event times are fitted too.*give `sigma`"):
        observations(_record())
    assert observations(_record(0.1)).weights[0, 0] == pytest.approx(10)
    assert observations(_record().between(0.0, 0.45)).event_times.size == 0


class _Free(AbstractScene):
    """Nothing that it could hit."""

    weight: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.weight[None]

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)

    def initial_state(self):
        return State([1.0], [0.0])


class _Decay(Sawtooth):
    """A flow without guards."""

    def guards(self, t, x, mode):
        return jnp.zeros(0)


@pytest.mark.parametrize("model", [_Free(9.81), _Decay(1.0, 1.0)])
def test_event_times_of_a_model_without_events_are_refused(model):
    """Assert that nothing is compiled, which ended the process without a word."""
    with pytest.raises(ValueError, match="must have events where event times are fitted.* but has none"):
        build_problem(model, measurements(event_times=[0.5], event_sigma=0.1), Unknowns())


@pytest.mark.parametrize("model", [BouncingBall(), Sawtooth(1.0, 1.0)])
def test_event_times_of_an_event_that_is_not_there_are_refused(model):
    """Assert that the second event of a model that has one is an error that says so."""
    with pytest.raises(ValueError, match="`event_contacts` must be below 1, the number of events of"):
        build_problem(model, measurements(event_times=[0.5], event_sigma=0.1, event_contacts=1), Unknowns())


@pytest.mark.slow
def test_event_times_that_are_left_of_a_record_have_their_sigmas():
    """Assert that a part of a record with event times alone gives the slope the error sigma slope^2 / (top |n|), n =
    2, 3, 4 being their numbers, and that NumPy has no complaint."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        result = fit(Sawtooth(1.8, 1.0), _record().between(0.6, 3.0), parameters="slope")
        text = str(result)
    assert "0 observations, 3 event times" in text
    n = np.array([2, 3, 4])
    expected = SIGMA * result.values[0] ** 2 / np.sqrt(np.sum(n**2))
    np.testing.assert_allclose(result.standard_errors["slope"], expected, rtol=1e-6)
    assert np.isinf(result.uncertainty.quantile_freedom)


class _Turning(AbstractHybridSystem):
    """x rises by `speed` until it comes to `place`, and by a tenth of it from there on."""

    speed: jax.Array
    place: jax.Array
    located_discontinuities = True

    def flow(self, t, x, mode):
        return jnp.where(x < self.place, 1.0, 0.1) * self.speed

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode

    def initial_state(self):
        return 0.0


@pytest.mark.slow
@pytest.mark.parametrize("contacts", [-1, 0])
def test_times_of_located_comparisons_are_fitted(contacts):
    """Assert that x = place at place / speed gives the place, and that the report calls the event by its name."""
    data = measurements(event_times=[0.6], event_sigma=1e-3, event_contacts=contacts)
    result = fit(_Turning(2.0, 1.0), data, parameters="place", t1=1.0)
    np.testing.assert_allclose(result.values, [1.2], rtol=1e-9)
    np.testing.assert_allclose(result.standard_errors["place"], 2 * 1e-3, rtol=1e-6)
    assert "events at the guess: 1 (comparison 0)" in str(result)


def test_a_comparison_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="`event_contacts` must be below 1, the number of events of"):
        data = measurements(event_times=[0.6], event_sigma=1e-3, event_contacts=1)
        build_problem(_Turning(2.0, 1.0), data, Unknowns())
