"""The command line: what it prints, what it writes, and how it refuses."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from importlib import import_module

import jax.numpy as jnp
import pytest

from hybridsens.cli import main
from hybridsens.cli.main import run
from hybridsens.comparison.functional import move, ready_made_motion
from hybridsens.scenes import SCENES
from hybridsens.systems import SYSTEMS
from tests.problems.stop_record import RECORD

demo = import_module("hybridsens.cli.demo")
FIT = ["fit", "elastic-stop", "--parameters", "mass", "--skip-missing", "--data", str(RECORD)]
STUDIES = ("estimation.fit", "sweeps.sweep", "cli.gradients.run_compare", "cli.gradients.run_work_precision")
PLAIN = """
import hybridsens as hs, jax, jax.numpy as jnp

print("imported")

class Plain(hs.AbstractScene):
    d: jax.Array = 0.6
    t1 = 1.0
    contacts = ("fence",)
    def initial_state(self): return hs.State([0.0], [2.0])
    def running_cost(self, t, q, v): return q @ q
    def mass_matrix(self, q): return jnp.eye(1)
    def force(self, t, q, v): return -q
    def gap(self, t, q): return self.d - q
    def restitution(self): return jnp.array([0.8])
"""
"""A file of one's own: no class or text of a ready-made scene, and words of its own."""
SWEEP = ["sweep", "elastic-stop", "--vary", "mass=1:2:3"]


@pytest.fixture(scope="module")
def shown():
    """What `demo` computes, once."""
    return demo.demonstrate(SCENES["elastic-stop"](), tolerance=1e-8)


def test_demo_shows_a_right_gradient_beside_a_wrong_one(shown, monkeypatch, tmp_path, capsys):
    """The jump adjoint agrees with differences to 1e-7, naive autodiff is off by all of it, a picture is written.

    The table fits a terminal, and as JSON there are the same numbers and nothing else."""
    monkeypatch.setattr(demo, "demonstrate", lambda scene, tolerance: shown)
    picture = tmp_path / "motion.png"
    monkeypatch.chdir(tmp_path)
    assert run(["demo", "--output", "motion.png"]) == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert "restitution_coefficient " in printed  # whole
    assert run(["demo", "--output", "motion.svg", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    place = found["parameters"].index("stiffness")
    slopes = [entry["gradient"][place] for entry in (found["reference"], *found["rows"])]
    (row,) = re.findall(r"stiffness +(\S+) +(\S+) +(\S+)", printed)
    assert [float(number) for number in row] == pytest.approx(slopes, 1e-8)
    assert [entry["method"] for entry in found["rows"]] == ["jump adjoint", "naive autodiff"]
    assert found["one_sided"] == ["restitution_coefficient"] and "restitution_coefficient)\n" in printed
    assert found["status"] == "successful" and [event["kind"] for event in found["events"]] == 5 * ["impact"]
    assert "<svg" in (tmp_path / "motion.svg").read_text()
    (errors,) = re.findall(r"largest error of the gradient: jump adjoint (\S+), naive autodiff (\S+)", printed)
    assert float(errors[0]) < 1e-7
    assert float(errors[1]) > 1
    assert len(re.findall(r"^ +\d+ +\S+ +impact", printed, re.MULTILINE)) == 5
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_demo_draws_the_motion_of_a_scene_of_ones_own(shown, monkeypatch, tmp_path, capsys):
    """Assert that gaps, velocities and contacts stand beside the gradients of a class that derives from no ready-made
    one; that it is not described by the signature that Python puts in the place of a text; and that its contact has
    its name in the list of events."""
    (tmp_path / "own.py").write_text(PLAIN)

    def moved(scene, tolerance):
        return shown._replace(motion=ready_made_motion(scene, move, ts=jnp.linspace(0.0, scene.t1, 20)))

    monkeypatch.setattr(demo, "demonstrate", moved)
    monkeypatch.chdir(tmp_path)
    assert run(["demo", "own.py:Plain", "--output", "own.svg"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("own.py:Plain\n\n")
    assert re.search(r"impact +fence", printed)
    picture = (tmp_path / "own.svg").read_text()
    assert all(f"<!-- {label} -->" in picture for label in ("gap [m]", "velocity", "time [s]"))


@pytest.mark.slow
def test_demo_shows_a_hybrid_system(tmp_path, capsys):
    """As of a scene: the loop with `where` holds the times of the switches constant."""
    picture = tmp_path / "motion.png"
    assert run(["demo", "thermostat", "--output", str(picture)]) == 0
    printed = capsys.readouterr().out
    (errors,) = re.findall(r"largest error of the gradient: jump adjoint (\S+), naive autodiff (\S+)", printed)
    assert float(errors[0]) < 1e-6 < 0.1 < float(errors[1])
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_demo_wraps_what_a_class_says_once():
    """Paragraphs stay, the line ends of the source go."""
    assert demo._filled("One\nline.\n\nAnother\n  one.") == "One line.\n\nAnother one."


def test_scenes_lists_every_scene_with_a_line(capsys):
    """Each name that `demo` takes stands at the start of a line that says what the scene is."""
    assert run(["scenes"]) == 0
    begun = re.findall(r"^  (\S+) +(\S.*)", capsys.readouterr().out, re.MULTILINE)
    assert [name for name, _ in begun] == [*SCENES, *SYSTEMS]
    assert all(len(text) > 10 for _, text in begun)


def _not_reached(*given, **named):
    raise AssertionError("Something is computed.")


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["demo", "nowhere"], "no scene 'nowhere'; choose elastic-stop"),
        (["demo", "newtons-cradle"], "no scene 'newtons-cradle'; choose elastic-stop"),
        (["demo", "newtons-cradle"], "A NewtonsCradle of any size is made in Python"),
        (["demo", "--tolerance", "0"], "tolerance must lie between"),
        (["demo", "--tolerance", "small"], "Invalid value for '--tolerance'"),
        (["demo", "--output", "motion.doc"], "must end in one of"),
        (["demo", "--output", "no/such/folder/motion.png"], "no folder no/such/folder"),
        (["compare", "--output", "no/x.png"], "--output': must lie in a folder that exists, but there is no folder no"),
        (["compare", "--csv", "no/x.csv"], "--csv': must lie in a folder that exists"),
        (["work-precision", "--output", "no/x.png"], "--output': must lie in a folder that exists"),
        (["work-precision", "--store", "no/x.csv"], "--store': must lie in a folder that exists"),
        ([*FIT, "--output", "no/x.png"], "--output': must lie in a folder that exists"),
        ([*FIT, "--output", "picture"], "picture must end in one of"),
        ([*FIT, "--guess", "mass=1", "--guess", "mass=2"], "--guess must have each name once, but has 'mass'"),
        ([*FIT, "--bound", "mass=0:1", "--bound", "mass=0:2"], "--bound must have each name once, but has 'mass'"),
        ([*SWEEP, "--output", "no/x.nc"], "--output': must lie in a folder that exists"),
        ([*SWEEP, "--output", "x.nc", "--plot", "no/x.png"], "--plot': must lie in a folder that exists"),
        ([*SWEEP, "--output", "x.nc", "--plot", "x.png"], "--plot must have a grid of two parameters"),
        ([*SWEEP, "--output", "x.nc", "--t1", "-1"], "--t1': must be later than 0, where the motions start"),
        ([*SWEEP, "--output", "x.nc", "--vary", "mass=3:4:2"], "--vary must have each name once, but has 'mass' in"),
        (["demo", "--colour", "red"], "--colour"),
        (["dance"], "dance"),
    ],
)
def test_bad_arguments_get_one_clear_line_and_a_status(arguments, reason, capsys, tmp_path, monkeypatch):
    """A mistake on the command line is named in one line on the error stream, before anything is computed, and the
    exit status is 2."""
    monkeypatch.chdir(tmp_path)
    for study in STUDIES:
        monkeypatch.setattr(f"hybridsens.{study}", _not_reached)
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.startswith("hybridsens: ")
    assert reason in line


def test_a_solver_that_is_refused_is_not_suggested(capsys):
    """Euler's method is one of Diffrax, without an error estimate."""
    assert run(["work-precision", "--solver", "Euler"]) == 2
    assert capsys.readouterr().err.endswith("no solver with an error estimate of the name 'Euler'.\n")


def test_the_console_script_configures_jax_and_passes_its_status_on():
    """A fresh process runs in double precision, and its exit status is that of the command."""
    code = "import sys, jax; from hybridsens.cli.main import main\n"
    code += "try: main()\nfinally: print(jax.config.jax_enable_x64)"
    ended = subprocess.run([sys.executable, "-c", code, "demo", "nowhere"], capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert ended.stdout.split() == ["True"]
    assert len(ended.stderr.splitlines()) == 1


def test_the_module_runs_as_the_console_script():
    ended = subprocess.run([sys.executable, "-m", "hybridsens", "nothing"], capture_output=True, text=True, check=False)
    assert ended.returncode == 2 and "there is no command 'nothing'; choose demo, scenes," in ended.stderr


def test_a_command_that_is_misspelt_is_told_the_nearest(capsys):
    assert run(["sweeep"]) == 2
    assert capsys.readouterr().err.endswith("Did you mean 'sweep'?\n")


def test_the_same_settings_may_be_made_twice():
    """Other ones may not, once JAX has started, but for the cache. A notebook's first cell can be run again, and a file
    that a command loads may have the call too."""
    code = (
        "import hybridsens, jax.numpy as jnp\n"
        "hybridsens.configure(cache=True, host_devices=2); jnp.ones(1); hybridsens.configure()\n"
        "import jax; assert str(jax.config.jax_compilation_cache_dir).endswith('hybridsens')\n"
        "hybridsens.configure(cache='elsewhere'); assert jax.config.jax_compilation_cache_dir == 'elsewhere'\n"
        "try:\n    hybridsens.configure(x64=False)\nexcept RuntimeError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.stdout.startswith("JAX has already started") and not done.stderr, done


@pytest.mark.slow
def test_ctrl_c_ends_a_command_that_compiles(tmp_path):
    """One line and the shells' exit status, not a crash of what was being compiled. Python swallows what is raised
    while it collects garbage, so there Ctrl-C comes again."""
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored in background jobs
    code += "import hybridsens.cli.main as cli\nprint('ready', flush=True)\ncli.main()"
    given = [sys.executable, "-u", "-c", code, "demo", "stacked-balls", "--output", str(tmp_path / "x.png")]
    cold = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    run = subprocess.Popen(given, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=cold)
    assert run.stdout is not None and run.stdout.readline() == "ready\n"
    time.sleep(4)
    while run.poll() is None:  # once is enough but where Python swallows it: in a destructor, say
        run.send_signal(signal.SIGINT)
        time.sleep(3)
    said = run.communicate()[1].splitlines()
    assert run.returncode == 130 and said[-1] == "hybridsens: interrupted", said


def test_ctrl_c_while_garbage_is_collected_comes_again(monkeypatch):
    asked, again = threading.Event(), []
    monkeypatch.setattr(os, "kill", lambda *given: again.append(given) or asked.set())
    interrupted = threading.Event()

    def _xla_gc_callback():  # as JAX names it
        main._interrupt(interrupted)(signal.SIGINT, sys._getframe())

    _xla_gc_callback()
    assert interrupted.is_set() and asked.wait(5) and again == [(os.getpid(), signal.SIGINT)]
    with pytest.raises(KeyboardInterrupt):
        main._interrupt(interrupted)(signal.SIGINT, None)
