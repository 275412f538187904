"""Every notebook runs from its first cell to its last, shows what it says it shows, and is made of its source."""

import json
import re
import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import hybridsens

FOLDER = Path(__file__).parents[2] / "notebooks"
SOURCES = sorted(FOLDER.glob("*.py"))
QUICK = {"first_bounce"}
"""The others are slow."""

# Nobody draws the animations of the notebooks here; they may be collected during any later test.
pytestmark = pytest.mark.filterwarnings("ignore:Animation was deleted:UserWarning")


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Runs a source with small settings, in an empty folder; gives what its cells have defined."""
    monkeypatch.setenv("HYBRIDSENS_NOTEBOOKS_SMALL", "1")
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr(hybridsens, "configure", lambda **settings: None)  # tests have done it already
    monkeypatch.chdir(tmp_path)
    yield lambda name: runpy.run_path(str(FOLDER / f"{name}.py"))
    plt.close("all")


def _cells(source: str) -> list[tuple[str, str]]:
    """Kind and text of every cell of a script in cells."""
    cells = re.split(r"^# %%(.*)\n", source, flags=re.MULTILINE)[1:]
    pairs = zip(cells[::2], cells[1::2], strict=True)
    bare = lambda text: re.sub(r"^# ?", "", text, flags=re.MULTILINE)
    return [("markdown", bare(text).strip()) if "markdown" in head else ("code", text.strip()) for head, text in pairs]


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_a_notebook_is_its_source_executed(source):
    """Cell by cell; all of it was run in order, without an error or a path of the machine, and there is a picture."""
    cells = json.loads(source.with_suffix(".ipynb").read_text())["cells"]
    texts = [(cell["cell_type"], "".join(cell["source"]).strip()) for cell in cells]
    assert texts == _cells(source.read_text()), f"python -m benchmarks.notebooks {source.stem} makes it anew"
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    said = [(kind, data) for output in outputs for kind, data in {**output, **output.get("data", {})}.items()]
    words = [data for kind, data in said if kind in ("text", "text/plain", "text/html")]
    assert not re.search(r"/(home|work|tmp|root|usr)/", json.dumps(words))


def test_notebooks_are_small_and_are_listed():
    """All of them take less than 3 MB, and a page leads from each question to its notebook."""
    notebooks = sorted(FOLDER.glob("*.ipynb"))
    assert [path.stem for path in notebooks] == [path.stem for path in SOURCES]
    assert sum(path.stat().st_size for path in notebooks) < 3e6
    told = (FOLDER / "README.md").read_text()
    assert [path.name for path in notebooks if f"]({path.name})" not in told] == []
    links = re.findall(r"\]\((\w+\.ipynb)\)", "".join(path.read_text() for path in SOURCES))
    assert set(links) <= {path.name for path in notebooks}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
        for name in (path.stem for path in SOURCES)
        if name not in {"naive_gradients", "dropped_ball", "control_through_impacts"}
    ],
)
def test_notebook_runs(name, run):
    """With what it asserts of its own numbers."""
    run(name)


@pytest.mark.slow
def test_the_bumper_helps(run):
    """Both controls lead to the same mark, one of them by an impact and with less effort; both descents descend."""
    shown = run("control_through_impacts")
    (motor, motor_history, _), (bumper, bumper_history, _) = shown["found"].values()
    assert [int(motion.events.count) for motion in shown["motions"].values()] == [0, 1]
    assert np.mean(bumper**2) < 0.6 * np.mean(motor**2)
    assert motor_history[-1] < motor_history[0] and bumper_history[-1] < 0.1 * bumper_history[0]


@pytest.mark.slow
def test_naive_gradients_tells_a_true_story(run):
    """The naive derivative of one bounce is 1, the exact one is not; on the stop only ours improves with the step."""
    shown = run("naive_gradients")
    _, exact, naive = shown["one_bounce"]
    assert naive == pytest.approx(1) and exact == pytest.approx(0.589201781, abs=1e-9)
    for name in ("`where` reset", "penalty contact"):
        assert all(error > 0.1 for _, error in shown["errors"][name])
    (_, loose), (_, tight) = shown["errors"]["hybridsens"]
    assert tight < 1e-7 < loose


@pytest.mark.slow
def test_a_real_ball_bounces_as_its_parabolas_say(run):
    """Restitution and the first impact of the measured ball, by parabolas through its two flights; the second impact,
    which was not fitted, comes within 8 ms; and the report says that the residuals are no noise."""
    shown = run("dropped_ball")
    result, record = shown["result"], shown["record"]
    t, z = record.times, record.values[:, 0]
    fall, rise = ((begin < t) & (t < end) for begin, end in ((0.4, 0.62), (0.65, 1.14)))
    down, up = (np.polynomial.Polynomial.fit(t[part], z[part], 2) for part in (fall, rise))
    floor = result.scene.floor.item()
    impact = min((root.real for root in (down - floor).roots()), key=lambda root: abs(root - 0.63))
    e = -up.deriv()(impact) / down.deriv()(impact)
    assert result.converged and abs(shown["bounce"] - impact) < 2e-3
    assert abs(result.scene.restitution_coefficient - e) < 0.02 and 0.38 < e < 0.45
    assert abs(shown["landing"] - 1.1484) < 8e-3 and result.uncertainty.noise < 4e-3
    assert result.residual_correlation["z"] > 0.7 and "alike from sample to sample" in str(result)
