"""A sweep from a terminal: what its file tells of it, and how it ends."""

import pytest

from hybridsens.cli.main import run

xr = pytest.importorskip("xarray")


@pytest.mark.slow
def test_a_file_tells_how_it_was_made_and_a_sweep_without_a_value_fails(tmp_path, capsys):
    """Two steps suffice for no motion. Only the print said what the horizon was, and the shell was told of success."""
    place = tmp_path / "map.nc"
    vary = ["--vary", "mass=1:2:2", "--output", str(place)]
    assert run(["sweep", "elastic-stop", *vary, "--t1", "3", "--tolerance", "1e-6", "--max-steps", "2"]) == 1
    assert "max_steps_reached" in (said := capsys.readouterr().out) and "No point has a value" in said
    with xr.open_dataset(place) as read:
        assert (read.attrs["t1"], read.attrs["tolerance"], read.attrs["model"]) == (3, 1e-6, "ElasticStop")
        assert read.attrs["made_by"].startswith("hybridsens ")
