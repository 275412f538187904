"""Codes of statuses, as a sweep returns them, are compared with a status wherever they are kept."""

import jax.numpy as jnp
import numpy as np
import pandas
import pytest
import xarray

import hybridsens as hs

CODES = np.array([0, 2, -1], np.int32)
"""A success, one that used up its events, and a point that was not computed."""


@pytest.mark.parametrize(
    "kept", [np.asarray, jnp.asarray, pandas.Series, xarray.DataArray, lambda codes: xarray.DataArray(codes).chunk()],
    ids=["NumPy", "JAX", "pandas", "xarray", "dask"],
)  # fmt: skip
def test_an_array_of_codes_is_compared_with_a_status(kept):
    """Assert that it is so from either side."""
    codes = kept(CODES)
    for found in (codes == hs.Status.successful, hs.Status.successful == codes):
        np.testing.assert_array_equal(np.asarray(found), [True, False, False])
    for found in (codes != hs.Status.max_events_reached, hs.Status.max_events_reached != codes):
        np.testing.assert_array_equal(np.asarray(found), [True, False, True])


def test_successful_points_of_a_dataset_are_chosen():
    """As the page about sweeps does it."""
    dataset = xarray.Dataset({"J": ("point", [1.0, 2.0, np.nan]), "status": ("point", CODES)})
    assert dataset.J.where(dataset.status == hs.Status.successful).max() == 1.0
    either = dataset.status.isin([hs.Status.successful, hs.Status.max_events_reached])
    assert either.values.tolist() == [True, True, False]


def test_a_code_says_what_it_means():
    assert hs.Status[int(hs.Status.grazing)] == hs.Status.grazing.message
    assert hs.Status[xarray.DataArray(CODES)[1]] == hs.Status.max_events_reached.message
    for code in (-1, 1000, 1.5, CODES):
        with pytest.raises(TypeError, match="must be given a status, or the code of one, but is given"):
            hs.Status[code]


def test_a_status_has_a_name_by_which_it_is_a_key():
    assert hs.Status.grazing.name == "grazing" == hs.Status.names()[int(hs.Status.grazing)]
    with pytest.raises(TypeError, match="use `status.name`"):
        hash(hs.Status.grazing)
