"""Every notebook runs from its first cell to its last, and shows what it says it shows."""

import os
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hybridsens

ROOT = Path(__file__).parents[2]
STORY = ROOT / "notebooks" / "naive_gradients.py"
BALL = ROOT / "notebooks" / "dropped_ball.py"
OTHERS = sorted(path for path in STORY.parent.glob("*.py") if path not in (STORY, BALL))


@pytest.mark.slow
def test_naive_gradients_tells_a_true_story(monkeypatch, tmp_path):
    """The naive derivative of one bounce is 1, the exact one is not; on the stop only ours improves with the step."""
    monkeypatch.setenv("HYBRIDSENS_NOTEBOOKS_SMALL", "1")
    monkeypatch.setattr(hybridsens, "configure", lambda: None)  # tests have done it already
    monkeypatch.chdir(tmp_path)
    shown = runpy.run_path(str(STORY))
    _, exact, naive = shown["one_bounce"]
    assert naive == pytest.approx(1) and exact == pytest.approx(0.589201781, abs=1e-9)
    for name in ("`where` reset", "penalty contact"):
        assert all(error > 0.1 for _, error in shown["errors"][name])
    (_, loose), (_, tight) = shown["errors"]["hybridsens"]
    assert tight < 1e-7 < loose
    assert (tmp_path / "naive_gradients.png").stat().st_size > 0


@pytest.mark.slow
def test_a_real_ball_bounces_as_its_parabolas_say(monkeypatch):
    """Restitution and the first impact of the measured ball, by parabolas through its two flights; the second impact,
    which was not fitted, comes within 8 ms; and the report says that the residuals are no noise."""
    monkeypatch.setattr(hybridsens, "configure", lambda: None)
    shown = runpy.run_path(str(BALL))
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


@pytest.mark.parametrize(
    "notebook",
    [pytest.param(path, marks=pytest.mark.slow) if path.stem == "parameter_maps" else path for path in OTHERS],
    ids=lambda path: path.stem,
)
def test_notebook_runs(notebook, tmp_path):
    """In a process of its own, as a reader runs it, with small settings."""
    cache = str(ROOT / ".jax_cache")
    small = {"HYBRIDSENS_NOTEBOOKS_SMALL": "1", "JAX_COMPILATION_CACHE_DIR": cache, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(
        [sys.executable, str(notebook)], cwd=tmp_path, env=os.environ | small, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr[-2000:]
