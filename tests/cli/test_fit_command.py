"""`hybridsens fit` reads a file, fits what is asked for, and says so."""

import json
import re
import signal
import subprocess
import sys

import pytest
import typer

from hybridsens.cli.fit import fit
from hybridsens.cli.main import run
from tests.problems.stop_record import RECORD


@pytest.mark.slow
def test_a_scene_of_one_s_own_is_fitted_from_a_file(tmp_path, capsys):
    """Assert that path/to/file.py:Class fits two parameters of SciPy's record and prints the true values."""
    module = tmp_path / "own.py"
    module.write_text(
        "from hybridsens.scenes import ElasticStop\n\nclass Own(ElasticStop):\n    distance: float = 0.7\n"
    )
    fit(f"{module}:Own", RECORD, "distance,restitution_coefficient",
        guess=["distance=0.61", "restitution_coefficient=0.78"],
        robust=2.0, skip_missing=True, output=tmp_path / "fit.png")  # fmt: skip
    printed = capsys.readouterr().out
    values = {
        line.split()[0]: float(line.split()[2]) for line in printed.splitlines() if line.startswith(("dist", "rest"))
    }
    assert abs(values["distance"] - 0.6) < 0.01 and abs(values["restitution_coefficient"] - 0.8) < 0.02
    assert (tmp_path / "fit.png").stat().st_size > 10_000


def test_the_column_of_times_is_told_by_name(monkeypatch, tmp_path):
    """Assert that `--time` reaches the reader, and that units are left to it."""
    record, taken = tmp_path / "record.csv", []
    record.write_text("when,q0 [m]\n0.1,0.2\n")
    monkeypatch.setattr("hybridsens.estimation.fit", lambda scene, data, **named: taken.append(data) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        fit("elastic-stop", record, "distance", time="when")
    assert taken[0].names == ("q0 [m]",) and taken[0].times == [0.1]


def test_advice_is_given_in_options(monkeypatch, tmp_path, capsys):
    """Assert that a report and an error name what a terminal has in the place of the arguments of a function."""
    record = tmp_path / "record.csv"
    record.write_text("t,q0\n0.1,0.2\n")
    words = "`starts=8` looks for another, and so does `strategy=GrowingHorizon()`"

    def refused(scene, data, **named):
        raise ValueError(words)

    monkeypatch.setattr("hybridsens.estimation.fit", refused)
    with pytest.raises(ValueError, match="^--starts 8 looks for another, and so does --grow$"):
        fit("elastic-stop", record, "distance")
    told = type("Told", (), {"converged": True, "__str__": lambda self: words})
    monkeypatch.setattr("hybridsens.estimation.fit", lambda scene, data, **named: told())
    fit("elastic-stop", record, "distance")
    assert capsys.readouterr().out == "--starts 8 looks for another, and so does --grow\n"
    record.write_text("t,q0\n0.1,0.2\n0.2,\n")
    with pytest.raises(ValueError, match="--skip-missing"):
        fit("elastic-stop", record, "distance")


def test_sigmas_come_from_the_file_or_from_the_option(monkeypatch, tmp_path):
    """Assert that `--sigma` does not take the place of the file's own in silence."""
    record, taken = tmp_path / "record.csv", []
    monkeypatch.setattr("hybridsens.estimation.fit", lambda scene, data, **named: taken.append(data) or 1 / 0)
    record.write_text("t,q0\n0.1,0.2\n")
    with pytest.raises(ZeroDivisionError):
        fit("elastic-stop", record, "distance", sigma=0.3)
    assert taken[0].sigmas == 0.3
    record.write_text("t,q0,sigma_q0\n0.1,0.2,0.01\n")
    with pytest.raises(typer.BadParameter, match="--sigma must be left out, since .*record.csv has columns sigma_"):
        fit("elastic-stop", record, "distance", sigma=0.3)


def test_what_is_not_there_is_named():
    """Assert that an unknown scene, file and bound are errors that say what is wrong."""
    for scene, message in (("no-such", "there is no scene"), ("none.py:Scene", "there is no file none.py")):
        with pytest.raises(typer.BadParameter, match=message):
            fit(scene, RECORD, "distance", skip_missing=True)
    with pytest.raises(typer.BadParameter, match="there is no scene 'elastic-stpo'.* Did you mean 'elastic-stop'"):
        fit("elastic-stpo", RECORD, "distance", skip_missing=True)
    with pytest.raises(typer.BadParameter, match="NAME=LO:HI"):
        fit("elastic-stop", RECORD, "distance", bound=["distance=1:2:3"], skip_missing=True)


@pytest.mark.parametrize(
    ("guess", "message"),
    [
        ("distance", "must have the form NAME=NUMBER, .* but is 'distance'"),
        ("distance=far", "must have the form NAME=NUMBER, .* but is 'distance=far'"),
        ("distnace=1", "a guess must have a name among .*, but has 'distnace'. Did you mean 'distance'"),
        ("distance=1,2", "a number for each of distance, but have 2"),
    ],
)
def test_a_guess_that_is_none_is_shown_as_it_was_given(guess, message):
    """Assert that a guess without a number, of no parameter, or with too many numbers is told what it must be."""
    with pytest.raises(typer.BadParameter, match=message):
        fit("elastic-stop", RECORD, "distance", guess=[guess], skip_missing=True)


def test_a_class_that_is_not_in_a_file_is_answered_with_those_that_are(tmp_path):
    """Assert that the scenes which a file defines are listed, and the one that was meant is named."""
    module = tmp_path / "own.py"
    module.write_text("from hybridsens.scenes import ElasticStop\n\nclass Cart(ElasticStop):\n    pass\n")
    with pytest.raises(typer.BadParameter, match=r"AbstractHybridSystem 'Crat', but has Cart. Did you mean 'Cart'"):
        fit(f"{module}:Crat", RECORD, "distance", skip_missing=True)
    module.write_text("import hybridsens\n")
    with pytest.raises(typer.BadParameter, match="but has none at all"):
        fit(f"{module}:Cart", RECORD, "distance", skip_missing=True)
    module.write_text(
        "import hybridsens, jax\n\nclass Cart(hybridsens.AbstractScene):\n    m: jax.Array\n"
        "    mass_matrix = force = gap = restitution = lambda self, *given: self.m\n"
    )
    with pytest.raises(typer.BadParameter, match="must have a default for every parameter, .* but .*missing.* 'm'"):
        fit(f"{module}:Cart", RECORD, "distance", skip_missing=True)


_FALLING = """
import hybridsens, jax, jax.numpy as jnp

class Falling(hybridsens.AbstractHybridSystem):
    speed: jax.Array = 1.0
    def flow(self, t, x, mode): return -self.speed
    def guards(self, t, x, mode): return jnp.zeros(0)
    def transition(self, event, t, x, mode): return x, mode
"""


def test_a_class_that_does_not_say_where_it_starts_is_one_line(tmp_path, capsys):
    """Assert that a model without `initial_state` is a mistake of the user, with its status and no traceback."""
    module = tmp_path / "own.py"
    module.write_text(_FALLING)
    status = run(["fit", f"{module}:Falling", "--data", str(RECORD), "--skip-missing", "--parameters", "speed"])
    printed = capsys.readouterr().err
    assert status == 2 and printed.count("\n") == 1
    assert "own.py:Falling must have a method `initial_state(self)`" in printed


@pytest.mark.slow
def test_json_has_the_doubts_of_the_report(tmp_path, capsys):
    """Assert that a parameter on which nothing depends is undetermined, and that heights in mm, which no speed
    explains, are remarked upon; the same in m are not."""
    module, record = tmp_path / "own.py", tmp_path / "record.csv"
    module.write_text(f"{_FALLING}    idle: jax.Array = 1.0\n    def initial_state(self): return 1.0\n")
    for unit, told in ((1000, True), (1, False)):
        rows = [f"{t},{unit * (1 - 0.5 * t + 0.01 * (-1) ** i)}\n" for i, t in enumerate((0.1, 0.2, 0.3, 0.4))]
        record.write_text("t,x\n" + "".join(rows))
        asked = ["--data", str(record), "--parameters", "speed,idle", "--json"]
        assert run(["fit", f"{module}:Falling", *asked]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["undetermined"] == ["idle"] and found["parameters"][1]["interval_95"] == [None, None]
        assert "not determined by the data: idle, since" in found["remarks"][0]
        assert any("residuals of x are as large" in remark for remark in found["remarks"]) == told


def test_a_file_without_a_class_is_answered_with_those_that_it_has(tmp_path):
    """Assert that it is told to write own.py:Class, and which classes there are."""
    module = tmp_path / "own.py"
    module.write_text(_FALLING)
    with pytest.raises(typer.BadParameter, match="own.py must be followed by .*own.py:Class; it has Falling"):
        fit(str(module), RECORD, "speed", skip_missing=True)
    module.write_text("import hybridsens")
    with pytest.raises(typer.BadParameter, match="it has no scene and no system"):
        fit(str(module), RECORD, "speed", skip_missing=True)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = 1\nclass Falling(:\n", "must be a Python file, but line 2 of {}"),
        ("import no_such_library", "{} must run as a Python file, but raises ModuleNotFoundError: No module named"),
        ("open('no/such/file')", "{} must run as a Python file, but raises FileNotFoundError"),
    ],
)
def test_a_file_that_does_not_run_is_named(text, told, tmp_path, capsys):
    """Assert that it is one line with the file, not the frames of the command."""
    module = tmp_path / "own.py"
    module.write_text(text)
    assert run(["scenes", f"{module}:Falling"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert told.format(module) in line


def test_a_class_that_refuses_its_own_defaults_is_named(tmp_path, capsys):
    """Assert that what its constructor raises is told with the class and the file."""
    module = tmp_path / "own.py"
    module.write_text(f"{_FALLING}    def __check_init__(self): raise ValueError('too slow')\n")
    assert run(["scenes", f"{module}:Falling"]) == 2
    printed = capsys.readouterr().err
    assert f"Falling of {module} must be made by Falling(), which raises ValueError: too slow" in printed


@pytest.mark.slow
def test_ctrl_c_prints_the_best_point_and_keeps_it(tmp_path):
    """Assert that a signal in the middle of a slow descent ends it with a table and a file, and that a second run goes
    on from that file."""
    kept = tmp_path / "best.json"
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "  # ignored in background jobs
    program = listen + "from hybridsens.cli.main import main; main()"
    command = [sys.executable, "-c", program, "fit", "elastic-stop", "--data", str(RECORD), "--skip-missing",
               "--parameters", "distance,restitution_coefficient", "--guess", "distance=0.7",
               "--guess", "restitution_coefficient=0.7", "--optimizer", "adam", "--store", str(kept),
               "--max-iterations"]  # fmt: skip
    with subprocess.Popen([*command, "100000"], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        lines = iter(run.stdout.readline, "")
        first = next(line for line in lines if line.split()[:2] == ["full", "0"])
        next(line for line in lines if line.split()[:2] == ["full", "20"])
        run.send_signal(signal.SIGINT)
        rest = "".join(lines)
    assert run.returncode == 1 and "fit interrupted after" in rest and "95 % interval" in rest
    best = json.loads(kept.read_text())["values"]
    again = subprocess.run([*command, "1"], stdout=subprocess.PIPE, text=True).stdout
    assert _loss(again) < 0.9 * _loss(first) and f"{best['distance']:.3g}"[:4] in again


def _loss(text):
    return float(re.search(r"loss (\S+)", text)[1])
