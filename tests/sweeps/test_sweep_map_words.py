"""What stands on a map beside its colours: units, and what lines and hatched points are."""

import jax.numpy as jnp
import pytest
import xarray as xr

from hybridsens.sweeps import grid, plot_sweep, sweep
from hybridsens.sweeps.plot import unknowns


def test_a_map_has_the_units_that_the_sweep_was_given_and_says_what_is_hatched():
    """Assert that J and its derivatives have theirs, and that nothing is said where nothing is hatched."""
    scene = {"a": jnp.array(1.0), "b": jnp.array(1.0)}
    design = grid(scene, {"a": [1.0, 2.0], "b": [-1.0, 1.0]})
    found = sweep(lambda s: jnp.sqrt(s["b"]) * s["a"], design, units={"J": "m", "a": "s"}, progress=False)
    drawn = plot_sweep(found)
    assert [axes.get_title() for axes in drawn.axes[:3]] == ["J [m]", "|dJ/d a| [m/s]", "|dJ/d b|"]
    assert drawn.get_supxlabel() == "hatched: failed"
    assert plot_sweep(found.isel(b=[1])).get_supxlabel() == ""


def test_a_point_without_a_derivative_has_not_failed():
    value = xr.DataArray([1.0, 2.0])
    maps = {"J": value, "|dJ/d a|": value.where(value > 1)}
    assert unknowns(maps, interrupted=False) == ["hatched where J is not: no derivative"]
    maps["J"] = value.where(value < 2)
    assert unknowns(maps, interrupted=True)[0] == "hatched: failed, or not computed"


QUOTIENTS = [("m", "N/m", "m/(N/m)"), ("m", "", "m"), ("", "s", "1/s"), ("N m", "rad", "(N m)/rad")]


@pytest.mark.parametrize("of, by, unit", QUOTIENTS)
def test_a_derivative_has_the_quotient_of_units(of, by, unit):
    scene = {"a": jnp.array(1.0)}
    found = sweep(lambda s: s["a"] ** 2, grid(scene, {"a": [1.0, 2.0]}), units={"J": of, "a": by}, progress=False)
    assert found.dJ_da.attrs["units"] == unit
