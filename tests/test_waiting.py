"""Who waits at a terminal or in a notebook is told for what and how long; a file and a pipe are told once a minute."""

import io
import sys
import threading
import time
from types import SimpleNamespace

import diffrax
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.compare_table import Reference
from hybridsens.estimation import fit
from hybridsens.sweeps.progress import progress_bar
from hybridsens.waiting import counted, waiting


class Terminal(io.StringIO):
    """An error stream that says it is a terminal."""

    def isatty(self):
        return True


def terminal_of(monkeypatch) -> Terminal:
    """A terminal as the error stream: put there by the test itself, since pytest puts its own there."""
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    return stream


def test_the_line_names_what_is_waited_for_and_counts_seconds(monkeypatch):
    """And is told of what comes next."""
    terminal = terminal_of(monkeypatch)
    with waiting("compiling", shown=True) as tell:
        time.sleep(1.2)
        tell("checking")
        time.sleep(0.3)
    shown = terminal.getvalue()
    assert "compiling ... 0 s" in shown and "compiling ... 1 s" in shown and "checking ... 1 s" in shown


@pytest.mark.parametrize("stream", [Terminal, io.StringIO])
def test_nothing_is_shown_that_was_not_asked_for_or_is_no_terminal(stream, monkeypatch):
    """A terminal without the wish, and the wish without a terminal."""
    kept = stream()
    monkeypatch.setattr(sys, "stderr", kept)
    wished = stream is io.StringIO
    with waiting("compiling", wished) as tell:
        tell("checking")
    assert list(counted("ab", str, wished)) == ["a", "b"] and kept.getvalue() == ""


def test_a_file_is_told_of_what_takes_long(monkeypatch):
    """What takes no longer than some seconds leaves no line in it; nothing can be wiped out there."""
    log = io.StringIO()
    monkeypatch.setattr(sys, "stderr", log)
    monkeypatch.setattr("hybridsens.waiting.FIRST_LINE", 0.3)
    monkeypatch.setattr("hybridsens.waiting.NEXT_LINE", 0.6)
    with waiting("compiling", shown=True) as tell:
        time.sleep(0.6)
        tell("checking")
        time.sleep(0.6)
    assert log.getvalue().splitlines() == ["compiling ... 0 s", "checking ... 1 s"]
    for _ in counted(["one", "two"], str, shown=True):
        time.sleep(0.2)
    assert log.getvalue().splitlines()[2:] == ["two, 2 of 2 ... 0 s"]
    with progress_bar(points=4000, present=1000, shown=True) as advance:
        advance(1500)
        time.sleep(0.4)
    assert log.getvalue().splitlines()[3:] == ["sweep, 2,500 of 4,000 points ... 0 s"]


def test_a_bar_names_each_thing(monkeypatch):
    """So that one knows which of them takes so long."""
    terminal = terminal_of(monkeypatch)
    for _ in counted(["one", "two"], lambda name: f"<{name}>", shown=True):
        time.sleep(0.15)
    assert all(part in terminal.getvalue() for part in ("<one>", "<two>", "1/2"))


@pytest.fixture
def cell(monkeypatch) -> list[tuple[str, str]]:
    """What is shown below a notebook's cell, by which thread's context: a kernel's display, whose lines can change."""
    shown = []
    note = lambda text, **given: shown.append((text["text/plain"], threading.current_thread().name))
    display = lambda text, **given: note(text) or SimpleNamespace(update=note)
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel=object())))
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=display))
    return shown


def test_a_notebook_shows_one_line_and_wipes_it_out(cell):
    """It counts while the main thread compiles; what is done within a second leaves no trace."""
    with waiting("compiling", shown=True) as tell:
        time.sleep(1.3)
        tell("checking")
        time.sleep(1)
    lines = [text for text, thread in cell if thread != "MainThread"]
    assert lines == ["compiling ... 1 s", "checking ... 2 s", ""] and len(cell) == 3
    for _ in counted(["one", "two"], str, shown=True):
        time.sleep(0.6)
    assert [text for text, _ in cell[3:]] == ["two, 2 of 2 ... 1 s", ""]
    with waiting("compiling", shown=True), waiting("compiling", shown=False):
        time.sleep(0.1)
    assert len(cell) == 5


def test_a_sweep_in_a_notebook_tells_how_far_it_is(cell, monkeypatch):
    """With the points that a store has already."""
    monkeypatch.setattr("hybridsens.waiting.TICK", 0.05)
    with progress_bar(points=4000, present=1000, shown=True) as advance:
        time.sleep(0.2)
        advance(1500)
        time.sleep(0.2)
    lines = [text for text, _ in cell]
    assert lines[0] == "compiling the sweep ... 0 s" and lines[-2:] == ["sweep, 2,500 of 4,000 points ... 0 s", ""]


def test_a_measurement_in_a_notebook_names_the_solver(cell, monkeypatch):
    """As on a terminal."""
    monkeypatch.setattr("hybridsens.waiting.TICK", 0.02)
    monkeypatch.setattr("hybridsens.comparison.work_precision.measure_line", lambda *given: time.sleep(0.2) or iter(()))
    reference = Reference(1.0, np.ones(1))
    monkeypatch.setattr("hybridsens.comparison.work_precision.tight_reference", lambda *given, **more: reference)
    hs.work_precision(hs.scenes.BouncingBall(), solvers=[diffrax.Tsit5()], dtypes=["float64"])
    assert cell[0][0] == "Tsit5, Replay, float64, 1 of 3 ... 0 s" and cell[-1][0] == ""


def test_what_fails_in_a_notebook_leaves_no_line(cell):
    """Nor a thread that goes on counting."""
    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt), waiting("compiling", shown=True):
        time.sleep(1.2)
        raise KeyboardInterrupt
    assert cell[-1][0] == "" and threading.active_count() == before


@pytest.mark.parametrize("kernel", [True, False])
def test_a_simulation_in_a_notebook_says_that_it_compiles(cell, kernel, monkeypatch):
    """If it was asked to, and if there is a kernel; IPython on a terminal has none."""
    monkeypatch.setattr("hybridsens.waiting.TICK", 0.02)
    if not kernel:
        monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: None)
    ball, room = hs.scenes.BouncingBall(), 5 + kernel  # each compiles anew
    hs.simulate(ball, ball.initial_state(), t1=0.4, max_events=room, progress=True)
    assert bool(cell) == kernel and (not kernel or cell[0][0] == "compiling and simulating ... 0 s")


def test_a_simulation_says_that_it_compiles(monkeypatch):
    """If it was asked to."""
    terminal, ball = terminal_of(monkeypatch), hs.scenes.BouncingBall()
    hs.simulate(ball, ball.initial_state(), t1=0.4, max_events=4)
    assert terminal.getvalue() == ""
    hs.simulate(ball, ball.initial_state(), t1=0.4, max_events=4, progress=True)
    assert "compiling and simulating ... " in terminal.getvalue()


def test_a_solution_says_that_it_compiles(monkeypatch):
    """If it was asked to."""
    terminal, heated = terminal_of(monkeypatch), hs.systems.Thermostat()
    for progress in (False, True):
        hs.solve(heated, heated.initial_state(), heated.initial_mode(), t1=0.1, max_events=4, progress=progress)
        assert ("compiling and simulating ... " in terminal.getvalue()) == progress


@pytest.mark.slow
def test_a_fit_says_that_it_compiles_until_its_first_line(monkeypatch, capfd):
    """The lines of its iterations follow on the other stream."""
    terminal, times = terminal_of(monkeypatch), np.linspace(0.1, 0.4, 4)
    fallen = {"t": times, "q0": 1 - 9.81 * times**2 / 2}
    fit(hs.scenes.BouncingBall(height=1.1), fallen, parameters="height", max_events=4, max_steps=64, progress=True)
    assert "compiling ... " in terminal.getvalue()
    assert "loss" in capfd.readouterr().out


def test_the_bar_of_a_million_points_fits_a_terminal(capsys, monkeypatch):
    """Assert that 80 characters cut nothing off."""
    monkeypatch.setenv("COLUMNS", "80")
    with progress_bar(2_000_000, 0, True) as advance:
        advance(999_999)
    shown = capsys.readouterr().out.splitlines()[-1]
    assert len(shown) <= 80 and "…" not in shown and "999999/2000000" in shown.replace(",", "")
