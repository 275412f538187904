"""The study of accuracy against time: errors fall with the tolerance, the front is one, the advice follows from it."""

import csv
import importlib
import re

import diffrax
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.cli.main import run
from hybridsens.comparison.compare import Reference
from hybridsens.comparison.functional import CallReport
from hybridsens.comparison.measure import Measured, measured
from hybridsens.comparison.work_precision import Point, WorkPrecision, plot_work_precision, work_precision
from hybridsens.comparison.work_precision_points import read_points, write_points
from hybridsens.scenes import ElasticStop
from tests.problems.references import RECORDS

work_precision_module = importlib.import_module("hybridsens.comparison.work_precision")
ROOM = dict(max_events=16, max_steps=2048)


@pytest.fixture(scope="module")
def reference():
    """P2 in the parameters of the scene: mass, stiffness k = omega^2 and damping c = 2 zeta omega by the chain rule.

    m q'' = -k q - c q' + A cos(Omega t) depends on (m, k, c, A) only through ratios, so
    m J_m = -(k J_k + c J_c + A J_A).
    """
    record = RECORDS["P2"]
    omega, zeta, A, _, _, _ = record["p"]
    by_omega, by_zeta, by_A, by_Omega, by_d, by_e = (float(entry) for entry in record["dJ"][0])
    c_slope = by_zeta / (2 * omega)
    k_slope = (by_omega - 2 * zeta * c_slope) / (2 * omega)
    m_slope = -(omega**2 * k_slope + 2 * zeta * omega * c_slope + A * by_A)
    gradient = np.array([m_slope, k_slope, c_slope, by_A, by_Omega, by_d, by_e])
    return Reference(float(record["J"][0]), gradient)


def scene():
    omega, zeta, A, Omega, d, e = RECORDS["P2"]["p"]
    return ElasticStop(1.0, omega**2, 2 * zeta * omega, A, Omega, d, e)


@pytest.mark.slow
def test_errors_fall_with_the_tolerance_and_points_are_written_as_they_come(tmp_path, reference):
    """By replay and by the continuous costate each factor of 1000 in the tolerance gains at least 100 in the gradient.

    At 1e-11 both are right to 1e-10; the CSV holds the same points.
    """
    path = tmp_path / "points.csv"
    methods = (hs.Replay(), hs.ContinuousCostate())
    study = work_precision(
        scene(), tolerances=(1e-5, 1e-8, 1e-11), solvers=[diffrax.Tsit5()], methods=methods, reference=reference,
        store=path, **ROOM, progress=False,
    )  # fmt: skip
    assert [point.method for point in study.points] == 3 * ["Replay"] + 3 * ["ContinuousCostate"]
    errors = [point.gradient_error for point in study.points]
    for loose, middle, tight in (errors[:3], errors[3:]):
        assert middle < loose / 100 and tight < middle / 100 and tight < 1e-10
    with open(path, newline="") as file:
        assert [float(line["gradient_error"]) for line in csv.DictReader(file)] == errors
    plot_work_precision(study).savefig(tmp_path / "points.png")


@pytest.mark.parametrize(("slowest", "ticks"), [(1.01e-4, [0.05, 0.1, 0.2]), (2e-2, [0.1, 0.2, 0.5, 1, 2, 5, 10, 20])])
def test_a_picture_holds_its_legend_and_few_ticks(slowest, ticks):
    """Of the command's default: three solvers, two methods, two types; of points whose times hardly differ, too."""
    methods, dtypes = ("Replay", "ForwardSensitivities"), ("float64", "float32")
    settings = [(s, m, d) for s in ("Bosh3", "Tsit5", "Dopri8") for m in methods for d in dtypes]
    points = [Point(*given, 1e-6, 1e-7, 1e-7, t) for given in settings for t in (1e-4, slowest)]
    figure = plot_work_precision(WorkPrecision(tuple(points)))
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert 0 <= box.x0 < box.x1 <= figure.bbox.width and 0 <= box.y0
    low, high = figure.axes[0].get_xlim()
    np.testing.assert_allclose([x for x in figure.axes[0].get_xticks() if low <= x <= high], ticks)


def test_an_error_that_is_not_known_is_on_no_front():
    """The fastest point, whose gradient is nan, beats none of the others."""
    fast = Point("Tsit5", "Replay", "float64", 1e-3, 1e-3, np.nan, 1e-5)
    good = Point("Dopri8", "Replay", "float64", 1e-9, 1e-9, 1e-9, 1e-4)
    study = WorkPrecision((fast, good))
    assert study.pareto() == [good] and study.pareto("value_error") == [fast, good]
    assert study.to_pandas()["tolerance"].tolist() == [1e-3, 1e-9]


def test_the_run_that_errors_are_measured_against_has_none():
    """It led the front with errors of 0; nor is it drawn, where 0 had a place at 1e-16."""
    itself = Point("Dopri8", "Replay", "float64", 1e-13, 0.0, 0.0, 1e-3)
    good = Point("Dopri8", "Replay", "float64", 1e-9, 1e-9, 1e-9, 1e-4)
    study = WorkPrecision((good, itself))
    assert study.pareto() == [good]
    assert re.search(r"\n  Dopri8, rtol 1e-13, Replay +\(as the reference\) +1.000 ms\n", str(study))
    assert all(len(line.get_xdata()) == 1 for axes in plot_work_precision(study).axes for line in axes.lines)


def test_a_gradient_that_is_nan_is_a_failure(reference):
    """Its motion is whole, so nothing else tells of it."""
    reached = CallReport((), (), ())
    with pytest.raises(FloatingPointError, match="not finite"):
        measured(lambda: (1.0, np.array([np.nan]), reached), reference)


class Meter:
    """Stands for the measurement of a point; `stops_at` is when Ctrl-C is pressed."""

    def __init__(self, stops_at=None):
        self.count, self.stops_at = 0, stops_at

    def __call__(self, call, reference):
        if self.count == self.stops_at:
            raise KeyboardInterrupt
        self.count += 1
        error = float("nan") if self.count == 2 else 1 / 3
        return Measured(1.0, np.ones(1), 1e-7, error, 0.1 * self.count, 0.5)


def test_an_interrupted_study_goes_on_where_it_stopped(tmp_path, reference, monkeypatch):
    """Three of eight points, then the five others; the file has every point once, to the last bit."""
    path = tmp_path / "points.csv"
    asked = dict(tolerances=(1e-4, 1e-5), solvers=[diffrax.Tsit5()], dtypes=("float64", "float32"))
    asked |= dict(methods=(hs.Replay(), hs.ContinuousCostate(rtol=1e-10)), reference=reference, store=path)
    monkeypatch.setattr(work_precision_module, "measured", first := Meter(stops_at=3))
    begun = work_precision(scene(), **asked, **ROOM, progress=False)
    assert begun.interrupted and len(begun.points) == first.count == 3
    assert _same(read_points(path, reference, ROOM), begun.points)
    monkeypatch.setattr(work_precision_module, "measured", second := Meter())
    whole = work_precision(scene(), **asked, **ROOM, progress=False)
    assert second.count == 5 and not whole.interrupted and _same(whole.points[:3], begun.points)
    assert len({point[:4] for point in whole.points}) == 8
    assert _same(read_points(path, reference, ROOM), whole.points)
    assert list(tmp_path.iterdir()) == [path]


def _same(found, expected) -> bool:
    return repr(found) == repr(expected)  # nan is nan here


def test_the_command_writes_points_and_goes_on_with_them(tmp_path, reference, monkeypatch, capsys):
    """Eleven tolerances by one solver and one method; the second run measures nothing and gives the same advice."""
    monkeypatch.setattr(work_precision_module, "tight_reference", lambda *scene: reference)
    picture, points = tmp_path / "picture.png", tmp_path / "kept.csv"
    asked = ["work-precision", "elastic-stop", "--no-single", "--solver", "Tsit5", "--method", "ContinuousCostate"]
    asked += ["--output", str(picture), "--store", str(points), "--target", "0.5"]
    monkeypatch.setattr(work_precision_module, "measured", first := Meter())
    assert run(asked) == 0 and first.count == 11
    printed = capsys.readouterr().out
    assert "for gradient error 5e-01 on this scene: Tsit5, rtol 1e-03, ContinuousCostate: 100 ms" in printed
    monkeypatch.setattr(work_precision_module, "measured", second := Meter())
    assert run(asked) == 0 and second.count == 0
    assert capsys.readouterr().out == printed and picture.read_bytes().startswith(b"\x89PNG")
    assert run(["work-precision", "--method", "Guessing"]) != 0
    assert "there is no gradient method 'Guessing'; choose one of Replay" in capsys.readouterr().err


def test_points_that_cannot_be_written_end_no_study(tmp_path, reference):
    with pytest.warns(UserWarning, match="cannot be written .*The study goes on"):
        write_points(tmp_path / "gone" / "points.csv", [Point("Tsit5", "Replay", "float64", 1e-7)], reference, {})


def test_a_file_of_something_else_is_refused(tmp_path, reference):
    """Points of another J or under other settings, another table, ending or folder; a setting that is varied."""
    path = tmp_path / "points.csv"
    point, settings = Point("Tsit5", "Replay", "float64", 1e-7), dict(max_events=256, max_steps=65536)
    write_points(path, [point], reference._replace(value=reference.value * 1.001), settings)
    with pytest.raises(ValueError, match="must have points of the same J"):
        work_precision(scene(), reference=reference, store=path)
    write_points(path, [point], reference._replace(gradient=1.001 * reference.gradient), settings)
    with pytest.raises(ValueError, match="must have points of the same gradient, but has those of another scene"):
        work_precision(scene(), reference=reference, store=path)
    write_points(path, [point], reference, settings)
    with pytest.raises(ValueError, match="under the settings max_events=100.*has some under max_events=256"):
        work_precision(scene(), reference=reference, store=path, max_events=100)
    whole = path.read_text()
    for cut in (whole[:-3], whole[: whole.rindex(",")]):
        path.write_text(cut)
        with pytest.raises(ValueError, match="must have whole lines, but is cut"):
            work_precision(scene(), reference=reference, store=path)
    path.write_text(whole, encoding="utf-16")
    with pytest.raises(ValueError, match="must be a CSV file in UTF-8"):
        work_precision(scene(), reference=reference, store=path)
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="must have the columns solver, method"):
        work_precision(scene(), reference=reference, store=path)
    with pytest.raises(ValueError, match="must end in .csv"):
        work_precision(scene(), reference=reference, store=tmp_path / "points.txt")
    with pytest.raises(ValueError, match="must lie in a folder that is there"):
        work_precision(scene(), reference=reference, store=tmp_path / "nowhere" / "points.csv")
    with pytest.raises(TypeError, match="must have settings among .*, but has rtol"):
        work_precision(scene(), reference=reference, rtol=1e-6)


@pytest.mark.slow
def test_float32_is_float32_and_restores_double_precision(reference):
    """In single precision the gradient is right to 1e-4 and not to 1e-8, and the setting is undone afterwards."""
    settings = dict(tolerances=(1e-5,), solvers=[diffrax.Tsit5()], methods=(hs.Replay(),), dtypes=("float32",))
    study = work_precision(scene(), reference=reference, **settings, **ROOM, progress=False)
    assert study.points[0].failure == ""
    assert 1e-8 < study.points[0].gradient_error < 1e-3
    assert scene().mass.dtype == np.float64


def test_tolerances_that_a_precision_cannot_meet_are_left_out(reference, monkeypatch):
    """Assert that float32 has points down to 1.9e-6, float64 has all, and that a line says so."""
    monkeypatch.setattr(work_precision_module, "measured", Meter())
    asked = dict(tolerances=(1e-5, 1e-6, 1e-13), dtypes=("float64", "float32"), solvers=[diffrax.Tsit5()])
    study = work_precision(scene(), **asked, methods=(hs.Replay(),), reference=reference, progress=False)
    assert [point.tolerance for point in study.points] == [1e-5, 1e-6, 1e-13, 1e-5]
    assert str(study).count("no float32 below 1.9e-06: it cannot meet such tolerances") == 1


def test_a_setting_that_fails_is_a_point_with_its_reason(reference):
    """Eight steps are too few; the point says so and the advice does not use it."""
    room = ROOM | dict(max_steps=8)
    asked = dict(tolerances=(1e-8,), solvers=[diffrax.Tsit5()], methods=(hs.Replay(),), reference=reference)
    study = work_precision(scene(), **asked, **room)
    assert "max_steps" in study.points[0].failure
    assert study.pareto() == [] and study.recommend(1.0) is None
    plot_work_precision(study)


def test_front_and_advice_follow_from_the_points():
    """Of four points one is beaten in both; the advice is the fastest that is accurate enough, in words."""
    rows = [(1e-2, 1.0), (1e-5, 2.0), (1e-4, 3.0), (1e-9, 9.0)]
    points = tuple(Point("Tsit5", "Replay", "float64", 1e-7, error, error, time) for error, time in rows)
    study = WorkPrecision(points)
    assert [point.seconds for point in study.pareto()] == [1, 2, 9]
    assert study.advice(1e-4) == "for gradient error 1e-04 on this scene: Tsit5, rtol 1e-07, Replay: 2e+03 ms"
    assert "no point reaches it" in study.advice(1e-12)


def test_an_unknown_precision_is_refused():
    """float16 is not one of the two."""
    with pytest.raises(ValueError, match="float16"):
        work_precision(scene(), dtypes=("float16",))


@pytest.mark.parametrize("one", [dict(tolerances=1e-6), dict(dtypes="float64"), dict(solvers=diffrax.Tsit5())])
def test_one_setting_where_a_list_is_asked_for_is_refused(one, unchecked):
    (name,) = one
    with pytest.raises(TypeError, match=f"`{name}` must be a list, but is .*Write {name}=\\["):
        work_precision(scene(), **one)
    with pytest.raises(TypeError, match="`solvers` must be a Diffrax solver"):
        work_precision(scene(), solvers=("Tsit5",))
