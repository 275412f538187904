"""Tables of a comparison and of a check: 80 columns, whatever the names, and no number is lost."""

import numpy as np
import pytest

from hybridsens.comparison.check_events import EventCheck
from hybridsens.comparison.check_report import Cause, GradientCheck, ParameterCheck
from hybridsens.comparison.compare_table import Comparison, Reference, Row
from hybridsens.comparison.work_precision_points import Point, WorkPrecision
from hybridsens.mechanics.mode import EventKind

SLOPE = -2.12345678912e-05
SHORT, LONG = ("mass", "k"), ("mass", "restitution_coefficient_of_the_wall")


def comparison(parameters):
    gradient = np.full(len(parameters), SLOPE)
    numbers = (-1.23456789, gradient, 1e-9, 2e-10, 1e-4, 3e-4, 12.5, 1.25e8)
    rows = (Row("Replay", *numbers), Row('ContinuousCostate(state="recorded")', *numbers), Row("naive", failure=WHY))
    return Comparison(parameters, Reference(-1.23456789, gradient), rows, True)


WHY = "ValueError: the naive methods know no events of this kind, which takes a sentence longer than a line to say."


def check(parameters):
    slopes = tuple(ParameterCheck(name, *3 * [SLOPE], 1e-9, SLOPE, "differences disagree") for name in parameters)
    events = (EventCheck(0, range(1), 0.3, EventKind.CAPTURE, 12, 1.5, 0.25, 0.25, "determinant disagrees"),)
    cause = Cause("jump", parameters, ("0:1",), "the force has an undeclared kink", "declare it by `jump_ts=`")
    return GradientCheck(slopes, events, (cause,))


def test_a_tiny_determinant_does_not_touch_its_neighbour():
    events = (EventCheck(0, range(1), 0.3, EventKind.CAPTURE, 12, 0.46654321, -1.86048e-189, 0.0, ""),)
    assert " 0.4665            0            0" in str(check(SHORT)._replace(events=events))


@pytest.mark.parametrize("table", [comparison, check])
@pytest.mark.parametrize("parameters", [SHORT, LONG], ids=["short", "long"])
def test_a_table_fits_a_terminal(table, parameters):
    lines = str(table(parameters)).splitlines()
    assert [line for line in lines if len(line) > 80] == []
    assert all(any(name in line for line in lines) for name in parameters)
    assert sum(line.count("-2.123456") for line in lines) >= 4


def test_a_parameter_whose_numbers_fit_has_one_line():
    """And only a name that is too long has two."""
    clean = lambda *names: GradientCheck(tuple(entry._replace(verdict="") for entry in check(names).parameters), ())
    lines = str(clean("k", "mass")).splitlines()
    assert [line.split()[:1] for line in lines] == [["dJ/d"], ["k"], ["mass"], [], ["All"]]
    assert len(str(clean("k", "stiffness")).splitlines()) == 5
    lines = str(clean("mass", "restitution_coefficient")).splitlines()
    assert [line.split()[0] for line in lines[:4]] == ["dJ/d", "mass", "restitution_coefficient", "-2.1234568e-05"]
    assert {len(line) for line in lines[:4]} - {len("restitution_coefficient")} == {80}


@pytest.mark.parametrize(("names", "shown"), [(("wall", "left wheel"), ["wall", "left wheel"]), (["w" * 11], ["12"])])
def test_events_of_a_check_name_their_contacts(names, shown):
    """By the scene's names, where these leave room for the numbers."""
    (entry,) = check(SHORT).events
    lines = str(GradientCheck(check(SHORT).parameters, tuple(entry._replace(contact_name=name) for name in names)))
    assert max(map(len, lines.splitlines())) <= 80
    assert all(f"capture {name:>{max(map(len, shown + ['contact']))}} " in lines for name in shown)


def test_what_is_said_of_a_row_stands_in_it_or_below():
    text = " ".join(str(check(SHORT)).split())
    assert "differences disagree" in text and "determinant disagrees" in text and "declare it by `jump_ts=`" in text
    assert " ".join(WHY.split()) in " ".join(str(comparison(SHORT)).split())


def test_of_points_that_a_clock_does_not_tell_apart_the_most_accurate_is_recommended():
    """And not one that is twice as accurate and takes half as long again."""
    point = lambda seconds, error: Point("Tsit5", "Replay()", "float64", error, error, error, seconds)
    points = point(1.0, 1e-7), point(1.05, 1e-9), point(1.5, 5e-10), point(0.5, 1e-3)
    assert WorkPrecision(points).recommend(1e-6) == points[1]
    assert WorkPrecision(points).recommend(1e-2) == points[3]
