"""Intervals of what is made of a fitted scene."""

import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.estimation.uncertainty import Uncertainty, band

NONE = np.full((3, 3), np.nan)


def known_by(covariance, exact=False):
    """What a fit of three parameters knows; many measurements."""
    return Uncertainty(covariance, np.zeros(3), NONE, 1.0, 100, np.inf, [], (), exact)


def test_a_parameter_itself_has_its_own_interval(near):
    names = ("distance", "stiffness")
    value, low, high = near.interval_of(lambda scene: jnp.stack([getattr(scene, name) for name in names]), 0.9)
    expected = np.array([near.intervals(0.9)[name] for name in names])
    np.testing.assert_allclose(value, near.values[[near.labels.index(name) for name in names]])
    np.testing.assert_allclose(np.stack([low, high], 1), expected, rtol=1e-12)


def test_errors_of_several_parameters_add_up_with_their_correlation():
    """p q^2 of (2, 3) with variances 0.01 and 0.04 and covariance -0.015: by (9, 12), not by the third parameter."""
    covariance = np.array([[0.01, -0.015, 0.0], [-0.015, 0.04, 0.0], [0.0, 0.0, 7.0]])
    product = lambda p: (p[0] * p[1] ** 2)[None]
    value, low, high = band(product, [2.0, 3.0, 5.0], known_by(covariance), 0.95)
    error = np.sqrt(81 * 0.01 + 144 * 0.04 - 2 * 9 * 12 * 0.015)
    np.testing.assert_allclose([value, high - value, value - low], [[18.0], [1.959964 * error], [1.959964 * error]])


def test_times_of_events_that_do_not_come_are_told():
    with pytest.warns(UserWarning, match="1 of 2 numbers that .* are not finite: times of events"):
        band(lambda p: jnp.stack([p[0], jnp.inf + 0 * p[1]]), [1.0, 2.0, 3.0], known_by(np.eye(3)), 0.95)


def test_what_the_data_do_not_tell_is_not_known_there():
    """One parameter that they say nothing of, one on its bound, where it is held, and one that they tell."""
    uncertainty = known_by(np.diag([0.25, np.inf, np.nan]))
    found = band(lambda p: jnp.stack([p[0] + p[2], p[0] * p[1], p[2]]), [1.0, 2.0, 3.0], uncertainty, 0.95)
    np.testing.assert_allclose(found.high - found.value, [1.959964 * 0.5, np.inf, 0.0])
    exact = band(lambda p: p, [1.0, 2.0, 3.0], known_by(np.diag([0.25, np.inf, 0.25]), exact=True), 0.95)
    assert np.isnan(exact.high).all()


def test_a_function_without_an_array_is_told(near):
    with pytest.raises(TypeError, match=r"must return an array of real numbers, but returns list"):
        near.interval_of(lambda scene: [scene.distance])
