"""Every notebook runs from its first cell to its last, and shows what it says it shows."""

import runpy
from pathlib import Path

import jax
import pytest

import hybridsens

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"


@pytest.fixture
def small(monkeypatch, tmp_path):
    """Small settings, pictures into a folder of their own, and a JAX that has started already."""
    monkeypatch.setenv("NOTEBOOK_SMALL", "1")
    monkeypatch.setenv("NOTEBOOK_OUTPUT", str(tmp_path))
    monkeypatch.setattr(hybridsens, "configure", lambda: None)
    assert jax.config.jax_enable_x64  # tests start with the same settings
    return tmp_path


def test_naive_gradients_tells_a_true_story(small):
    """The naive derivative of one bounce is 1 at any step, the exact one is not; on the stop only ours gets better."""
    shown = runpy.run_path(str(NOTEBOOKS / "naive_gradients.py"))
    _, exact, naive = shown["one_bounce"]
    assert naive == pytest.approx(1) and exact == pytest.approx(0.589201781, abs=1e-9)
    for name in ("`where` reset", "penalty contact"):
        assert all(error > 0.1 for _, error in shown["errors"][name])
    (_, loose), (_, tight) = shown["errors"]["hybridsens"]
    assert tight < 1e-7 < loose
    assert (small / "naive_gradients.png").stat().st_size > 0


def test_every_notebook_is_run_here():
    """A notebook without a test of its own would go stale."""
    tested = {"naive_gradients.py"}
    assert {path.name for path in NOTEBOOKS.iterdir() if path.is_file()} == tested
