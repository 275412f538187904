"""What is said of a place where the store of a sweep cannot be, and of points that make no map."""

import re

import jax.numpy as jnp
import pytest

from hybridsens.sweeps import grid, plot_sweep, sobol, sweep


def test_a_store_below_a_file_is_refused_by_its_name(tmp_path):
    """Assert that the place that was given is named, and not one that the sweep made up."""
    (tmp_path / "notes.txt").write_text("no folder")
    place = tmp_path / "notes.txt" / "sweep.zarr"
    design = grid({"a": jnp.array(1.0)}, {"a": [1.0, 2.0]})
    with pytest.raises(OSError, match=f"`store` must be in a folder that .*{re.escape(str(place))} is not"):
        sweep(lambda s: s["a"] ** 2, design, store=place, progress=False)


@pytest.mark.parametrize("name", ["map.csv", "map.nc"])
def test_a_store_with_the_ending_of_another_file_is_refused(name, tmp_path):
    """It would be a folder of that name."""
    design = grid({"a": jnp.array(1.0)}, {"a": [1.0, 2.0]})
    with pytest.raises(ValueError, match="`store` must be a Zarr store, a folder such as map.zarr"):
        sweep(lambda s: s["a"] ** 2, design, store=tmp_path / name, progress=False)


def test_points_that_are_no_grid_are_not_drawn_as_a_map():
    scene = {"a": jnp.array(1.0), "b": jnp.array(1.0)}
    found = sweep(lambda s: s["a"] * s["b"], sobol(scene, {"a": (0.0, 1.0), "b": (0.0, 1.0)}, 4), progress=False)
    with pytest.raises(ValueError, match=r"draw `dataset.plot.scatter\(x='a', y='J'\)`"):
        plot_sweep(found)
