"""Who waits at a terminal is told for what and how long; a file, a pipe and a notebook are told nothing."""

import io
import sys
import time

import numpy as np
import pytest

import hybridsens as hs
from hybridsens.estimation import fit
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


def test_a_bar_names_each_thing(monkeypatch):
    """So that one knows which of them takes so long."""
    terminal = terminal_of(monkeypatch)
    for _ in counted(["one", "two"], lambda name: f"<{name}>", shown=True):
        time.sleep(0.15)
    assert all(part in terminal.getvalue() for part in ("<one>", "<two>", "1/2"))


def test_a_simulation_says_that_it_compiles(monkeypatch):
    """If it was asked to."""
    terminal, ball = terminal_of(monkeypatch), hs.scenes.BouncingBall()
    hs.simulate(ball, ball.initial_state(), t1=0.4, max_events=4)
    assert terminal.getvalue() == ""
    hs.simulate(ball, ball.initial_state(), t1=0.4, max_events=4, progress=True)
    assert "compiling and simulating ... " in terminal.getvalue()


@pytest.mark.slow
def test_a_fit_says_that_it_compiles_until_its_first_line(monkeypatch, capfd):
    """The lines of its iterations follow on the other stream."""
    terminal, times = terminal_of(monkeypatch), np.linspace(0.1, 0.4, 4)
    fallen = {"t": times, "q0": 1 - 9.81 * times**2 / 2}
    fit(hs.scenes.BouncingBall(height=1.1), fallen, parameters="height", max_events=4, max_steps=64, progress=True)
    assert "compiling ... " in terminal.getvalue()
    assert "loss" in capfd.readouterr().out
