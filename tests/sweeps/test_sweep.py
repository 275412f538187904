"""Sweeps against closed forms: a dropped ball that bounces once, or not at all."""

import json
import subprocess
import sys
import warnings

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import hybridsens
from hybridsens.scenes import BouncingBall
from hybridsens.sweeps import grid, status_counts, sweep

HEIGHTS, RESTITUTIONS, G, T = np.linspace(1.0, 8.0, 8), np.linspace(0.7, 0.9, 3), 9.81, 1.0


class Ball(BouncingBall):
    """Compiles faster than a ball that may come to rest."""

    sustained_contact = False


def final_height(ball):
    """q(T), and the motion."""
    trajectory = hybridsens.simulate(ball, ball.initial_state(), t1=T, max_events=4, max_steps=64, throw=False)
    return trajectory.final.q[0], trajectory


def closed_form(height, restitution):
    """q(T) and its derivatives by height and restitution, with at most one impact before T."""
    fall = np.sqrt(2 * height / G)
    rest = T - fall
    bounced = restitution * G * fall * rest - G * rest**2 / 2
    by_height = (restitution * G * (rest - fall) + G * rest) / (G * fall)
    flying = fall > T
    return (
        np.where(flying, height - G * T**2 / 2, bounced),
        np.where(flying, 1.0, by_height),
        np.where(flying, 0.0, G * fall * rest),
    )


@pytest.fixture(scope="module")
def dataset():
    design = grid(Ball(), {"height": HEIGHTS, "restitution_coefficient": RESTITUTIONS})
    return sweep(final_height, design, chunk=10, units={"height": "m", "J": "m"}, progress=False)


def test_values_and_gradients_are_the_closed_form(dataset):
    """Assert that J and its derivatives are the closed form's at every point of the grid, on its named dimensions."""
    j, by_height, by_restitution = closed_form(*np.meshgrid(HEIGHTS, RESTITUTIONS, indexing="ij"))
    assert dataset.J.dims == ("height", "restitution_coefficient")
    np.testing.assert_allclose(dataset.J, j, rtol=1e-9)
    np.testing.assert_allclose(dataset.dJ_dheight, by_height, rtol=1e-9)
    np.testing.assert_allclose(dataset.dJ_drestitution_coefficient, by_restitution, rtol=1e-9, atol=1e-9)
    assert dataset.dJ_dheight.attrs["units"] == "m/m"
    fixed = {"mass": 1.0, "weight": G, "floor": 0.0, "velocity": 0.0}
    assert dataset.attrs["model"] == "Ball" and json.loads(dataset.attrs["fixed"]) == fixed


def test_the_event_summary_is_the_closed_form(dataset):
    """Assert that impacts are counted and timed, and how far they are from grazing."""
    bounced = HEIGHTS < G / 2
    np.testing.assert_array_equal(dataset.event_count[:, 0], bounced)
    fall = np.where(bounced, np.sqrt(2 * HEIGHTS / G), np.nan)
    np.testing.assert_allclose(dataset.event_time[:, 0, 0], fall, rtol=1e-12)
    np.testing.assert_allclose(dataset.grazing_margin[:, 0], G * fall, rtol=1e-10)
    assert len(np.unique(dataset.event_sequence)) == 2
    assert np.isnan(dataset.event_time[:, :, 1:]).all()


@pytest.mark.slow
def test_a_cascade_that_dies_away_is_no_graze():
    """Assert that a ball that comes to rest is as far from grazing as its first impact is fast."""

    def at_rest(ball):
        motion = hybridsens.simulate(ball, ball.initial_state(), t1=3.0, max_events=64, max_steps=512, throw=False)
        return motion.final.q[0], motion

    heights = np.array([0.5, 1.0])
    found = sweep(at_rest, grid(BouncingBall(restitution_coefficient=0.5), {"height": heights}), progress=False)
    assert np.all(found.event_count > 10)
    np.testing.assert_allclose(found.grazing_margin, np.sqrt(2 * G * heights), rtol=1e-8)


def test_a_dataset_comes_back_from_a_file_as_it_was(dataset, tmp_path):
    """Assert that netCDF and Zarr files hold the same values, names and units."""
    with warnings.catch_warnings():  # xarray's Zarr writer warns about its own choice of format
        warnings.simplefilter("ignore")
        dataset.to_netcdf(tmp_path / "sweep.nc")
        dataset.to_zarr(tmp_path / "sweep.zarr")
        with xr.open_dataset(tmp_path / "sweep.nc") as read:
            xr.testing.assert_equal(read.load(), dataset)
            assert read.dJ_dheight.attrs["units"] == "m/m"
        xr.testing.assert_equal(xr.open_zarr(tmp_path / "sweep.zarr", chunks=None).load(), dataset)


def test_bad_points_are_marked_and_do_not_stop_the_others():
    """Assert that a ball below the floor and one with e > 1 are named and NaN, among points that are right."""
    heights, restitutions = np.array([1.0, -1.0, 2.0]), np.array([0.8, 0.9, 1.5])
    found = sweep(
        final_height, grid(Ball(), {"height": heights, "restitution_coefficient": restitutions}), progress=False
    )
    assert status_counts(found) == {"successful": 4, "penetration": 2, "bad_restitution": 3}
    good = np.array([[True, True, False], [False, False, False], [True, True, False]])
    for name in ("J", "dJ_dheight", "dJ_dmass"):
        np.testing.assert_array_equal(np.isfinite(found[name]), good)
    expected = closed_form(*np.meshgrid(heights[::2], restitutions[:2], indexing="ij"))[0]
    np.testing.assert_allclose(found.J[::2, :2], expected, rtol=1e-9)


def test_a_motion_that_nothing_is_known_of_is_told():
    """Assert that a word comes where a point that breaks off would count as successful."""
    alone = lambda ball: final_height(ball)[0]
    with pytest.warns(UserWarning, match="returns J alone, of a motion with `throw=False`"):
        sweep(alone, grid(Ball(), {"height": [1.0]}), gradient=False, progress=False)


def test_a_cost_that_is_not_finite_is_told_from_a_motion_that_broke_off():
    """Assert that the time of an event that does not come is no fault of the motion."""

    def second_impact(ball):
        _, motion = final_height(ball)
        return motion.events.time[1], motion

    found = sweep(second_impact, grid(Ball(), {"height": [0.5, 1.0]}), gradient=False, progress=False)
    assert status_counts(found) == {"successful": 1, "cost_not_finite": 1}


def test_a_cost_without_a_motion_is_swept_too():
    """Assert that a plain function has its values and the gradient that was asked for, and NaN is marked."""
    scene = {"a": jnp.array(1.0), "b": jnp.array([2.0, 3.0])}
    design = grid(scene, {"a": np.array([-1.0, 1.0, 4.0]), "b[1]": np.array([0.5, 2.0])})
    found = sweep(lambda s: jnp.sqrt(s["a"]) * s["b"] @ s["b"], design, gradient=["b"], progress=False)
    a, b = np.meshgrid([np.nan, 1.0, 4.0], [0.5, 2.0], indexing="ij")
    np.testing.assert_allclose(found.J, np.sqrt(a) * (4 + b**2), rtol=1e-15)
    np.testing.assert_allclose(found.dJ_db[:, :, 1], 2 * np.sqrt(a) * b, rtol=1e-15)
    assert status_counts(found) == {"successful": 4, "non_finite": 2} and "dJ_da" not in found


def test_scenes_with_a_leading_axis_are_points():
    """Assert that a batch of scenes is swept over the dimension `point`, with every leaf as a coordinate."""
    scenes = {"a": jnp.arange(4.0), "b": jnp.arange(8.0).reshape(4, 2)}
    found = sweep(lambda s: s["a"] * s["b"][0] * s["b"][1], scenes, progress=False, chunk=3)
    a, b = np.arange(4.0), np.arange(8.0).reshape(4, 2)
    np.testing.assert_array_equal(found.dJ_da, b[:, 0] * b[:, 1])
    np.testing.assert_array_equal(found.dJ_db, a[:, None] * b[:, ::-1])
    assert found.a.dims == ("point",) and found.b.dims == ("point", "b_0")


def test_integers_and_booleans_of_a_batch_vary_from_point_to_point(tmp_path):
    """Assert that each point has its own, with no derivative by them, and that a store and a file keep them."""
    scenes = {"k": jnp.array([1.0, 2.0, 3.0]), "gear": jnp.array([2, 0, 1]), "on": jnp.array([True, False, True])}
    ratios = jnp.array([10.0, 20.0, 30.0])
    found = sweep(
        lambda s: jnp.where(s["on"], ratios[s["gear"]].sum() * s["k"], 0.0), scenes, progress=False,
        chunk=np.int64(2), events=np.int32(1), store=tmp_path / "sweep.zarr",
    )  # fmt: skip
    np.testing.assert_array_equal(found.J, [30, 0, 60])
    np.testing.assert_array_equal(found.dJ_dk, [30, 0, 20])
    assert "dJ_dgear" not in found and found.gear.values.tolist() == [2, 0, 1]
    found.to_netcdf(tmp_path / "sweep.nc")
    with xr.open_dataset(tmp_path / "sweep.nc") as read:
        assert read.on.values.tolist() == [True, False, True]


def test_one_name_is_a_gradient_too():
    """Assert that a name of several letters is not read letter by letter, and a wrong one is told as it is."""
    design = grid({"mass": jnp.array(1.0)}, {"mass": [2.0, 3.0]})
    found = sweep(lambda s: s["mass"] ** 2, design, gradient="mass", progress=False)
    np.testing.assert_array_equal(found.dJ_dmass, [4, 6])
    with pytest.raises(ValueError, match="must have names among mass, but has masss. Did you mean 'mass'"):
        sweep(lambda s: s["mass"] ** 2, design, gradient="masss", progress=False)


@pytest.mark.slow
def test_lanes_in_step_give_what_lanes_one_by_one_give(dataset):
    """Assert that mapped and vmapped lanes agree to rounding (the second is how accelerators run)."""
    vmapped = sweep(
        final_height,
        grid(Ball(), {"height": HEIGHTS, "restitution_coefficient": RESTITUTIONS}),
        chunk=10,
        progress=False,
        mapped=False,
    )
    xr.testing.assert_allclose(vmapped, dataset, rtol=1e-12)


TWO_DEVICES = """
import hybridsens
hybridsens.configure(host_devices=2)
import jax, numpy as np
from hybridsens.scenes import ElasticStop
from hybridsens.sweeps import random, sweep
def cost(stop):
    trajectory = hybridsens.simulate(stop, stop.initial_state(), t1=20.0, max_events=16, max_steps=512, throw=False)
    return trajectory.final.v[0], trajectory
design = random(ElasticStop(), {"amplitude": (0.5, 1.5), "restitution_coefficient": (0.5, 0.9)}, 33)
one, two = (sweep(cost, design, progress=False, devices=jax.devices()[:n]) for n in (1, 2))
assert len(jax.devices()) == 2 and int(one.event_count.max()) >= 4
gradients = [name for name in one.data_vars if name.startswith("dJ")]
assert all(np.array_equal(one[name], two[name], equal_nan=True) for name in set(one.data_vars) - set(gradients))
assert len(gradients) == 7 and all(np.allclose(one[name], two[name], rtol=1e-13, atol=0) for name in gradients)
"""


@pytest.mark.slow
def test_two_devices_give_what_one_gives():
    """Assert that a sweep over both devices of a process is that over one, values and events to the last bit; gradients
    to rounding, since XLA compiles a loop over half as many points once more."""
    subprocess.run([sys.executable, "-c", TWO_DEVICES], check=True, timeout=300)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda d: sweep(lambda s: s["a"] * jnp.ones(2), d, progress=False), ValueError, "must have a real scalar"),
        (
            lambda d: sweep(lambda s: (s["a"], s["a"]), d, progress=False),
            TypeError,
            r"must return J, or \(J, motion\)",
        ),
        (lambda d: sweep(lambda s: s["a"], d, states=True), ValueError, "With states=True the cost must"),
        (lambda d: sweep(lambda s: s["a"], d, gradient=["b"]), ValueError, "must have names among a"),
        (lambda d: sweep(lambda s: s["a"], d, units={"x": "m"}), ValueError, "must be of parameters or results"),
        (lambda d: sweep(lambda s: s["a"], d, chunk=0), ValueError, "must be an integer >= 1"),
        (lambda d: sweep(lambda s: s["a"], d, client=object()), ValueError, "must have a `store`"),
        (
            lambda d: sweep(lambda s: s["J"], grid({"J": jnp.ones(())}, {"J": [1.0]})),
            ValueError,
            "must not have the names",
        ),
    ],
)
def test_what_does_not_fit_is_refused(call, error, words):
    """Assert that a cost, a name or a setting that a sweep cannot use raises at once and says what it must be."""
    with pytest.raises(error, match=words):
        call(grid({"a": jnp.array(1.0)}, {"a": [1.0, 2.0]}))


def test_a_point_that_raises_says_what_to_do():
    def thrown(ball):
        return hybridsens.simulate(ball, ball.initial_state(), t1=T, max_events=4, max_steps=64).final.q[0]

    with pytest.raises(hybridsens.SimulationError, match="throw=False.* penetrates"):
        sweep(thrown, grid(Ball(), {"height": [1.0, -1.0]}), progress=False)
