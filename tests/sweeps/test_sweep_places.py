"""Where the store of a sweep cannot be, and what is said of it."""

import re

import jax.numpy as jnp
import pytest

from hybridsens.sweeps import grid, sweep


def test_a_store_below_a_file_is_refused_by_its_name(tmp_path):
    """Assert that the place that was given is named, and not one that the sweep made up."""
    (tmp_path / "notes.txt").write_text("no folder")
    place = tmp_path / "notes.txt" / "sweep.zarr"
    design = grid({"a": jnp.array(1.0)}, {"a": [1.0, 2.0]})
    with pytest.raises(OSError, match=f"`store` must be in a folder that .*{re.escape(str(place))} is not"):
        sweep(lambda s: s["a"] ** 2, design, store=place, progress=False)
