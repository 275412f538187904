"""`hybridsens fit` reads a file, fits what is asked for, and says so."""

import json
import re
import signal
import subprocess
import sys

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


def test_ctrl_c_prints_the_best_point_and_keeps_it(tmp_path):
    """Assert that a signal in the middle of a slow descent ends it with a table and a file, and that a second run goes
    on from that file."""
    kept = tmp_path / "best.json"
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "  # ignored in background jobs
    program = listen + "from hybridsens.commands.main import main; main()"
    command = [sys.executable, "-c", program, "fit", "elastic-stop", "--data", str(RECORD), "--skip-missing",
               "--parameters", "distance,restitution_coefficient", "--guess", "distance=0.7",
               "--guess", "restitution_coefficient=0.7", "--optimizer", "adam", "--checkpoint", str(kept),
               "--max-iterations"]  # fmt: skip
    with subprocess.Popen([*command, "100000"], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        lines = iter(run.stdout.readline, "")
        first = next(line for line in lines if line.split()[:2] == ["full", "0"])
        next(line for line in lines if line.split()[:2] == ["full", "20"])
        run.send_signal(signal.SIGINT)
        rest = "".join(lines)
    assert run.returncode == 1 and "fit interrupted after" in rest and "95 % interval" in rest
    best = json.loads(kept.read_text())
    again = subprocess.run([*command, "1"], stdout=subprocess.PIPE, text=True).stdout
    assert _loss(again) < 0.9 * _loss(first) and f"{best['distance']:.3g}"[:4] in again


def _loss(text):
    return float(re.search(r"loss (\S+)", text)[1])
