"""Global sensitivity against the Ishigami function, whose indices are known in closed form."""

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import hybridsens as hs
from hybridsens.sweeps import dgsm, grid, latin_hypercube, random, saltelli, sobol, sobol_indices, sweep

SCENE = {"x": jnp.zeros(2), "z": jnp.array(0.0)}
BOX = {name: (-np.pi, np.pi) for name in ("x[0]", "x[1]", "z")}
A, B = 7.0, 0.1


def ishigami(scene):
    """sin x + a sin^2 y + b z^4 sin x  (Ishigami and Homma 1990)."""
    x, y = scene["x"]
    return jnp.sin(x) + A * jnp.sin(y) ** 2 + B * scene["z"] ** 4 * jnp.sin(x)


@pytest.fixture(scope="module")
def dataset():
    return sweep(ishigami, saltelli(SCENE, BOX, 4096), progress=False)


def test_sobol_indices_are_the_closed_form(dataset):
    """Assert that first and total orders are within 0.01 of the exact ones, and inside their own intervals."""
    parts = np.array([(1 + B * np.pi**4 / 5) ** 2 / 2, A**2 / 8, 0.0])
    joint = B**2 * np.pi**8 * (1 / 18 - 1 / 50)
    variance = parts.sum() + joint
    found = sobol_indices(dataset)
    assert list(found.parameter.values) == list(BOX)
    exact = {"first_order": parts / variance, "total_order": (parts + joint * np.array([1, 0, 1])) / variance}
    for order, indices in exact.items():
        np.testing.assert_allclose(found[order], indices, atol=0.01)
        low, high = found[f"{order}_interval"].values.T
        assert (low - 0.01 <= indices).all() and (indices <= high + 0.01).all()


def test_derivative_based_measures_are_the_closed_form_and_bound_the_total_indices(dataset):
    """Assert that E[(dJ/dx)^2] is the exact integral within 2 %, and its bound lies above the total index."""
    by_x = (1 + 2 * B * np.pi**4 / 5 + B**2 * np.pi**8 / 9) / 2
    exact = [by_x, A**2 / 2, 16 * B**2 * np.pi**6 / 7 / 2]
    found = dgsm(dataset)
    np.testing.assert_allclose(found.nu, exact, rtol=0.02)
    assert (found.total_order_bound > sobol_indices(dataset).total_order).all()


def test_rows_with_a_failed_point_are_left_out_with_a_word(dataset):
    """Assert that a NaN does not spoil the indices, and is not passed over in silence."""
    spoiled = dataset.copy(deep=True)
    spoiled.J[5] = np.nan
    with pytest.warns(UserWarning, match="1 of 4096 rows"):
        found = sobol_indices(spoiled)
    np.testing.assert_allclose(found.first_order, sobol_indices(dataset).first_order, atol=0.01)


def test_counts_of_a_motion_that_broke_off_are_left_out_too(dataset):
    """Assert that a failed point is known by its status, where its result is a finite number."""
    counted = dataset.copy(deep=True).assign(event_count=("point", np.round(dataset.J.values).astype(int)))
    counted.status[5] = hs.Status.max_events_reached.code
    with pytest.warns(UserWarning, match="1 of 4096 rows"):
        sobol_indices(counted, "event_count")


@pytest.mark.parametrize("size", [1e-200, 1e160])
def test_shares_have_no_unit(dataset, size):
    """Assert that they are those of the same result in another unit: squares were 0 or infinite."""
    np.testing.assert_allclose(
        sobol_indices(dataset.assign(J=size * dataset.J)).total_order, sobol_indices(dataset).total_order, rtol=1e-12
    )


@pytest.mark.parametrize("confidence", [95.0, 0.0, -0.5])
def test_a_confidence_is_a_probability(dataset, confidence):
    with pytest.raises(ValueError, match="`confidence` must lie inside"):
        sobol_indices(dataset, confidence=confidence)


def test_a_grazing_point_does_not_spoil_derivative_based_measures(dataset):
    """Assert that one point with a J and no gradient is left out with a word: all measures were nan."""
    spoiled = dataset.copy(deep=True)
    spoiled.dJ_dz[5] = np.nan
    with pytest.warns(UserWarning, match="1 of 20480 points have no J or no gradient"):
        found = dgsm(spoiled)
    np.testing.assert_allclose(found.nu, dgsm(dataset).nu, rtol=1e-3)


def test_sequences_of_events_that_differ_are_told_with_derivative_based_measures(dataset):
    """Assert that a J which may jump between two of them is not passed over; the same everywhere is no word."""
    sequences = dataset.assign(event_sequence=("point", np.zeros(dataset.J.size, int)))
    dgsm(sequences)
    sequences.event_sequence[[3, 5]] = [7, -2]
    with pytest.warns(UserWarning, match="The points have 3 sequences of events. If J jumps"):
        dgsm(sequences)


@pytest.mark.parametrize("measure", [sobol_indices, dgsm])
@pytest.mark.parametrize("rounding", [0, 3e-16])
def test_a_constant_has_no_shares(measure, rounding):
    """Assert that indices of a result that does not vary, but for rounding, are refused, instead of nan."""
    constant = sweep(lambda scene: 2.0 + rounding * scene["z"], saltelli(SCENE, BOX, 8), progress=False)
    with pytest.raises(ValueError, match="J must vary over the points.* but is 2 at all of them"):
        measure(constant)


def test_indices_are_those_of_a_scalar_result(dataset):
    with pytest.raises(ValueError, match="`value` must be the name of a scalar result, one of J.*but is 'energy'"):
        sobol_indices(dataset, value="energy")


def test_indices_need_their_design():
    """Assert that a grid is refused by both."""
    swept = sweep(ishigami, grid(SCENE, {"z": [0.0, 1.0]}), progress=False)
    with pytest.raises(ValueError, match="need points of a `saltelli` design"):
        sobol_indices(swept)
    with pytest.raises(ValueError, match="must be drawn from a box"):
        dgsm(swept)


WEIGHTS = {"z": jnp.array(0.0), "a": jnp.array(0.0), "m": jnp.zeros((1, 2))}
UNIT = {name: (0.0, 1.0) for name in ("z", "m[0, 1]", "a")}


def weighted(scene):
    """Its variance has the shares 100, 9 and 1 of 110."""
    return 10 * scene["z"] + 3 * scene["m"][0, 1] + scene["a"]


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """A sweep with a store, whose coordinates come back by the alphabet, and over an entry with a space in its name."""
    store = tmp_path_factory.mktemp("store") / "sweep.zarr"
    return sweep(weighted, saltelli(WEIGHTS, UNIT, 256), progress=False, store=store)


@pytest.mark.filterwarnings("ignore:coordinate .* has a space in its name")
def test_indices_from_a_store_or_a_file_belong_to_their_parameters(stored, tmp_path):
    """Assert that first orders and derivatives are those of a sum, each by the name of its parameter."""
    stored.to_netcdf(tmp_path / "sweep.nc")
    with xr.open_dataset(tmp_path / "sweep.nc") as read:
        for found in (stored, read):
            assert list(sobol_indices(found).parameter.values) == list(UNIT)
            np.testing.assert_allclose(sobol_indices(found).first_order, np.array([100, 9, 1]) / 110, atol=0.02)
            np.testing.assert_allclose(dgsm(found).nu, [100, 9, 1], rtol=1e-12)


def test_indices_of_points_in_another_order_are_refused(stored):
    """Assert that parameters, rows or points in other places are told of."""
    with pytest.raises(ValueError, match="must have the attribute `varied`"):
        sobol_indices(stored.drop_attrs(deep=False).assign_attrs(design="saltelli"))
    with pytest.raises(ValueError, match="must be all those of the `saltelli` design"):
        sobol_indices(stored.assign_attrs(varied='["a", "m[0, 1]", "z"]'))
    for points in (slice(0, 1000), slice(None, None, -1)):
        with pytest.raises(ValueError, match="must be all those of the `saltelli` design"):
            sobol_indices(stored.isel(point=points))


@pytest.mark.parametrize("design", [random, latin_hypercube, sobol, saltelli])
@pytest.mark.parametrize("on_disk", [False, True])
def test_points_of_a_box_go_into_a_file(design, on_disk, tmp_path):
    """Assert that netCDF keeps the box of every design, also of a sweep with a store."""
    store = tmp_path / "sweep.zarr" if on_disk else None
    found = sweep(weighted, design(WEIGHTS, {"z": (2.0, 3.0)}, 4), progress=False, store=store)
    found.to_netcdf(tmp_path / "sweep.nc")
    with xr.open_dataset(tmp_path / "sweep.nc") as read:
        assert read.attrs["design"] == design.__name__
        assert (read.z.attrs["lowest"], read.z.attrs["highest"]) == (2, 3)
