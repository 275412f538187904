"""The loss of a fit is half a sum of squares, so that a profile knows where an interval ends."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from hybridsens import AbstractHybridSystem
from hybridsens.estimation import fit, measurements

TIMES = np.linspace(0.05, 1.0, 20)
SIGMA = 0.1
SEEN = 1 + 2 * TIMES + SIGMA * np.random.default_rng(0).normal(size=20)
LEAST = dict(max_events=2, max_steps=64)


class _Line(AbstractHybridSystem):
    """x = start + slope t, of which least squares have a closed form."""

    slope: jax.Array
    start: jax.Array

    def flow(self, t, x, mode):
        return self.slope

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode

    def initial_state(self):
        return self.start


@pytest.mark.slow
def test_the_loss_is_half_the_sum_of_squares():
    """Assert that it is so with sigmas and a prior."""
    data = measurements(TIMES, SEEN, sigma=SIGMA, names=["x"])
    result = fit(_Line(1.0, 1.0), data, priors={"slope": (1.5, 0.2)}, **LEAST)
    squares = np.sum((result.residuals / SIGMA) ** 2) + ((result.values[0] - 1.5) / 0.2) ** 2
    assert result.loss == pytest.approx(squares / 2)


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [SIGMA, None])
def test_a_profile_rises_as_the_page_says_to_the_ends_of_an_interval(sigma):
    """Assert that the loss, the slope being held there, is 1.92 higher; without sigmas the rise is relative to the
    noise, and that of Student's quantile."""
    data = measurements(TIMES, SEEN, sigma=sigma, names=["x"])
    result = fit(_Line(1.0, 1.0), data, **LEAST)
    for end in result.intervals()["slope"]:
        held = fit(_Line(end, 1.0), data, parameters=["start"], **LEAST)
        rise = (held.loss - result.loss) / (1.0 if sigma else result.uncertainty.noise**2)
        assert rise == pytest.approx(1.92 if sigma else stats.t.ppf(0.975, 20 - 2) ** 2 / 2, rel=1e-3)
