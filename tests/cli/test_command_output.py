"""What commands print for people fits 80 columns; for programs there is JSON; help has examples that parse."""

import importlib
import json
import os
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
import typer

import hybridsens as hs
from hybridsens.cli.help_texts import EXAMPLES, SHORT
from hybridsens.cli.main import app, run
from hybridsens.cli.models import runnable
from hybridsens.comparison.compare import Reference
from hybridsens.comparison.functional import ready_made_motion
from hybridsens.comparison.work_precision_points import write_points
from hybridsens.scenes import SCENES
from hybridsens.systems import SYSTEMS

COMMANDS = typer.main.get_command(app).commands


def _lines(capsys) -> list[str]:
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("command", ["", *SHORT])
def test_help_fits_a_terminal_and_is_not_cut(command, monkeypatch, capsys):
    """80 columns, no line that ends in dots, and an example of every command in its help."""
    monkeypatch.setenv("COLUMNS", "80")
    assert run([command, "--help"] if command else ["--help"]) == 0
    lines = _lines(capsys)
    assert max(map(len, lines)) <= 80
    assert [line for line in lines[1:] if line.endswith("...")] == []
    assert command == "" or EXAMPLES[command][0] in "\n".join(lines)


@pytest.mark.parametrize("command", SHORT)
def test_examples_parse(command):
    """Every option of an example is one that the command has."""
    for example in "\n".join(EXAMPLES[command]).replace("\\\n", " ").splitlines():
        program, name, *arguments = shlex.split(example)
        assert (program, name) == ("hybridsens", command)
        COMMANDS[command].make_context(command, arguments)


@pytest.mark.parametrize("name", ["", *SCENES, *SYSTEMS])
def test_scenes_fit_a_terminal(name, capsys):
    """The list, and every scene with its parameters."""
    assert run(["scenes", name] if name else ["scenes"]) == 0
    assert max(map(len, _lines(capsys))) <= 80


def test_parameters_have_defaults_units_and_meanings(tmp_path, capsys):
    """Of a ready-made scene, and of a class in a file, which adds one field to those that it inherits."""
    file = tmp_path / "own.py"
    file.write_text(
        "from hybridsens.scenes import ElasticStop\n\n"
        "class Own(ElasticStop):\n    distance: float = 0.25\n    '''Of the stop [mm].'''\n"
    )
    assert run(["scenes", "bouncing-ball"]) == 0
    rows = [re.split(r"\s{2,}", line) for line in _lines(capsys)]
    assert ["height", "1", "m", "Initial height"] in rows
    assert ["restitution_coefficient", "0.8", "e, in [0, 1]"] in rows  # no unit, but an interval
    assert run(["scenes", "bouncing-ball", "--json"]) == 0
    (ball,) = json.loads(capsys.readouterr().out)
    weight = next(entry for entry in ball["parameters"] if entry["name"] == "weight")
    assert weight == {"name": "weight", "default": 9.81, "unit": "N", "about": ""}
    assert run(["scenes", f"{file}:Own", "--json"]) == 0
    (own,) = json.loads(capsys.readouterr().out)
    assert own["about"] == ""  # and not the signature of the class
    assert {"stiffness": "N/m"}.items() <= {entry["name"]: entry["unit"] for entry in own["parameters"]}.items()


def test_what_a_file_prints_is_not_among_json(tmp_path, capsys):
    """Assert that it goes to the error stream."""
    file = tmp_path / "own.py"
    file.write_text("from hybridsens.scenes import ElasticStop\n\nclass Own(ElasticStop): pass\n\nprint('a word')\n")
    assert run(["scenes", f"{file}:Own", "--json"]) == 0
    captured = capsys.readouterr()
    assert [entry["name"] for entry in json.loads(captured.out)] == [f"{file}:Own"]
    assert captured.err == "a word\n"


def test_a_class_of_ones_own_is_described_once_in_columns(tmp_path, monkeypatch, capsys):
    """Assert that its text is its heading where its module has none, and that short names stand below their heading."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(
        "import hybridsens as hs, jax\n\nclass Own(hs.AbstractScene):\n    '''A cart.\n\n    It rolls.'''\n"
        "    m: jax.Array = 1.0\n    '''Of it.'''\n    mass_matrix = force = gap = restitution = lambda *given: given\n"
    )
    assert run(["scenes", "own.py:Own"]) == 0
    first, _, more, _, heading, row = _lines(capsys)
    assert (first, more) == ("own.py:Own: A cart.", "It rolls.")
    assert heading.index("default") == row.index("1") and heading.index("meaning") == row.index("Of it")


@pytest.mark.slow
def test_check_prints_json_and_its_status(capsys):
    """The gradient of a ball is right: status 0."""
    assert run(["check", "bouncing-ball", "--json", "--max-events", "16", "--max-steps", "4096"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["ok"] and {entry["verdict"] for entry in found["parameters"]} == {""}


def test_the_shell_is_told_the_names_of_scenes():
    """As bash asks for them."""
    code = "from hybridsens.cli.main import app; app(prog_name='hybridsens')"
    asked = {"_HYBRIDSENS_COMPLETE": "complete_bash", "COMP_WORDS": "hybridsens demo pend", "COMP_CWORD": "2"}
    done = subprocess.run([sys.executable, "-c", code], env=os.environ | asked, capture_output=True, text=True)
    assert done.stdout.split() == ["pendulum-wall"], done.stderr


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["dmeo"], "'demo'"),
        (["demo", "pendulum-wal"], "'pendulum-wall'"),
        (["demo", "--tolerence", "1"], "--tolerance"),
        (["work-precision", "--solver", "Tsit"], "'Tsit5'"),
        (["work-precision", "--method", "Reply"], "'Replay'"),
        (["sweep", "elastic-stop", "--vary", "mass=1:2", "--output", "x.nc", "--design", "sobl"], "'sobol'"),
        (["sweep", "elastic-stop", "--vary", "mas=1:2:3", "--output", "x.nc"], "'mass'"),
    ],
)
def test_a_misspelt_name_is_answered_with_the_one_that_was_meant(arguments, meant, capsys):
    """Of commands, scenes, options, solvers, methods, designs and parameters."""
    assert run(arguments) != 0
    assert meant in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vary", "mass=1:2:3", "--design", "random"], "a random design takes NAME=LOW:HIGH for mass"),
        (["--vary", "mass=1:2:3", "--points", "50"], "--points must be left out for a grid"),
        (["--vary", "mass=1:2:3", "--seed", "1"], "--seed must be left out for a grid"),
    ],
)
def test_what_a_design_does_not_take_is_refused(arguments, message, capsys):
    """Numbers and options that the design has no use for were ignored."""
    assert run(["sweep", "elastic-stop", "--output", "x.nc", *arguments]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_the_command_removes_no_file_but_the_points_of_a_study_before(tmp_path, monkeypatch, capsys):
    """Data beside the picture stay, of the same name or of that of the points."""
    module = importlib.import_module("hybridsens.cli.gradients")
    monkeypatch.setattr(module, "run_work_precision", lambda *scene, **rest: hs.WorkPrecision(()))
    data, points = tmp_path / "data.csv", tmp_path / "data-points.csv"
    asked = ["work-precision", "elastic-stop", "--output", str(tmp_path / "data.png")]
    write_points(points, (), Reference(1.0, np.ones(1)), {})
    data.write_text("t,q\n")
    assert run(asked) == 0 and data.read_text() == "t,q\n" and not points.exists()
    points.write_text("t,q\n")
    assert run(asked) == 2 and points.read_text() == "t,q\n"
    assert "holds no points of a study" in capsys.readouterr().err


def test_an_end_that_an_option_gives_need_not_be_the_scenes_own(tmp_path):
    """`sweep --t1` of a class without `t1`. The motion is only asked for here."""
    file = tmp_path / "own.py"
    file.write_text(
        "import hybridsens as hs\n\nclass Own(hs.AbstractScene):\n"
        "    mass_matrix = force = gap = restitution = running_cost = lambda *given: 0.0\n"
        "    initial_state = lambda self: None\n"
    )
    with pytest.raises(typer.BadParameter, match="must have t1: write it in the class, as `t1 = 10.0`, or derive"):
        runnable(f"{file}:Own")
    asked = ready_made_motion(runnable(f"{file}:Own", given=["t1"]), lambda scene, start, **settings: settings, t1=3.0)
    assert asked["t1"] == 3.0 and callable(asked["running_cost"])


OWN = """import hybridsens as hs, jax, jax.numpy as jnp

class Own(hs.scenes.BouncingBall):
    def force(self, t, q, v):
        return {}
"""


@pytest.mark.parametrize(
    ("force", "told"),
    [
        ("'nothing'", "must return"),
        ("jnp.zeros(3)", "must return an array of shape (1,)"),
        ("None + 1", "(own.py, line 5, in force)"),
        ("jnp.zeros(3) + v + jnp.zeros(2)", "Raised by `force`"),
        ("jnp.zeros(3) + jnp.zeros(2)", "(own.py, line 5, in force)"),
        ("jnp.reshape(v, (2,))", "(own.py, line 5, in force)"),
    ],
)
def test_what_is_wrong_in_a_file_is_one_line(force, told, tmp_path, capsys, unchecked):
    """What this package finds, of types and of shapes; and what Python and JAX find, with the user's own line."""
    file = tmp_path / "own.py"
    file.write_text(OWN.format(force))
    assert run(["check", f"{file}:Own"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("hybridsens: ") and told in line


def test_what_a_library_finds_wrong_keeps_its_lines(monkeypatch):
    """A TypeError from beyond this package, to which no line of the user's file led, is not cut."""
    module = importlib.import_module("hybridsens.cli.gradients")
    monkeypatch.setattr(module, "check_gradient", lambda scene, **settings: None + 1)
    with pytest.raises(TypeError, match="unsupported operand"):
        run(["check", "bouncing-ball"])
