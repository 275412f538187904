"""`hybridsens fit` reads a file, fits what is asked for, and says so."""

import pytest
import typer
from stop_record import RECORD

from hybridsens.commands.fit import fit


def test_a_scene_of_one_s_own_is_fitted_from_a_file(tmp_path, capsys):
    """Assert that path/to/file.py:Class fits two parameters of SciPy's record and prints the true values."""
    module = tmp_path / "own.py"
    module.write_text(
        "from hybridsens.scenes import ElasticStop\n\nclass Own(ElasticStop):\n    distance: float = 0.7\n"
    )
    fit(f"{module}:Own", RECORD, "distance,restitution_coefficient",
        guess=["distance=0.61", "restitution_coefficient=0.78"],
        robust=2.0, skip_missing=True, plot=tmp_path / "fit.png")  # fmt: skip
    printed = capsys.readouterr().out
    values = {
        line.split()[0]: float(line.split()[2]) for line in printed.splitlines() if line.startswith(("dist", "rest"))
    }
    assert abs(values["distance"] - 0.6) < 0.01 and abs(values["restitution_coefficient"] - 0.8) < 0.02
    assert (tmp_path / "fit.png").stat().st_size > 10_000


def test_what_is_not_there_is_named():
    """Assert that an unknown scene, file and bound are errors that say what is wrong."""
    for scene, message in (("no-such", "there is no scene"), ("none.py:Scene", "there is no file none.py")):
        with pytest.raises(typer.BadParameter, match=message):
            fit(scene, RECORD, "distance", skip_missing=True)
    with pytest.raises(typer.BadParameter, match="NAME=LO:HI"):
        fit("elastic-stop", RECORD, "distance", bound=["distance=1:2:3"], skip_missing=True)
