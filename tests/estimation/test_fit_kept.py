"""What a store holds is given up for a better point alone; and small steps alone make no minimum."""

import json

import numpy as np
import optax
import pytest

from hybridsens.estimation import GrowingHorizon, RandomStarts, fit
from tests.problems.sawtooth import Sawtooth

TIMES = np.linspace(0.05, 0.4, 8)
RECORD = {"t": TIMES, "x": 1 - 2 * TIMES + 0.01 * np.cos(40 * TIMES), "sigma_x": np.full(8, 0.01)}
SLOPE = float(TIMES @ (1 - RECORD["x"]) / (TIMES @ TIMES))
"""The best one, of a line through (0, 1)."""
ASKED = dict(parameters="slope", max_events=4, max_steps=64)
GUESS = Sawtooth(1.2, 1.0)


@pytest.mark.slow
def test_stages_never_replace_a_better_point_that_was_kept(tmp_path):
    """Assert it of a fit that is stopped in a stage, whose best point is that of a part of the record, and of one whose
    stages leave it no time to come back; without a kept point the file holds what a stage has found."""
    path, growing = tmp_path / "best.json", GrowingHorizon(first=0.1, trust=0.01, steps=1)
    in_stage = lambda line: line.stage != "full" and line.number == 1
    new = fit(GUESS, RECORD, store=path, strategy=growing, progress=in_stage, **ASKED)
    assert new.stopped == "stopped by the callback" and _slope(path) == new.values[0] != 1.2
    best = fit(GUESS, RECORD, store=path, **ASKED)
    assert best.values[0] == pytest.approx(SLOPE, rel=1e-6) and _slope(path) == best.values[0]
    stopped = fit(GUESS, RECORD, store=path, strategy=growing, progress=in_stage, **ASKED)
    assert stopped.stopped == "stopped by the callback"
    short = fit(GUESS, RECORD, store=path, strategy=growing, max_iterations=1, patience=1, **ASKED)
    for later in (stopped, short):
        assert later.values[0] == pytest.approx(SLOPE, rel=1e-6) and later.loss <= best.loss * (1 + 1e-12)
    assert _slope(path) == pytest.approx(SLOPE, rel=1e-6)


@pytest.mark.slow
def test_more_starts_than_before_begin_around_what_was_kept(tmp_path):
    """Assert that the same number does not begin again: their best point is what the file holds."""
    path, some = tmp_path / "best.json", RandomStarts(2, 0.5)
    assert fit(GUESS, RECORD, store=path, **ASKED).starts is None
    first = fit(GUESS, RECORD, store=path, starts=some, **ASKED)
    assert first.starts.loss.shape == (2,) and json.loads(path.read_text())["starts"] == 2
    assert fit(GUESS, RECORD, store=path, starts=some, **ASKED).starts is None
    assert fit(GUESS, RECORD, store=path, starts=3, **ASKED).starts.loss.shape == (3,)


TINY = optax.sgd(1e-16)


@pytest.mark.slow
@pytest.mark.parametrize("optimizer", [TINY, optax.sgd(optax.linear_schedule(0.0, 1e-3, 4))], ids=["tiny", "warm-up"])
def test_steps_that_a_schedule_makes_small_are_no_minimum(optimizer):
    """Assert that the first one, which was called converged at the guess, is not, and that the report says which are
    too short."""
    found = fit(GUESS, RECORD, optimizer=optimizer, max_iterations=3, **ASKED)
    assert found.stopped == "max_iterations" and found.iterations == 3 and not found.converged
    assert ("steps are too short" in str(found)) == (optimizer is TINY)


@pytest.mark.slow
def test_starts_that_stay_have_not_converged():
    """Assert it of each of them."""
    found = fit(GUESS, RECORD, optimizer=TINY, starts=2, max_iterations=3, **ASKED)
    assert found.starts.converged.tolist() == [False, False]
    found = fit(GUESS, RECORD, optimizer="lbfgs", starts=2, **ASKED)
    assert found.starts.converged.all() and found.values[0] == pytest.approx(SLOPE, rel=1e-6)


def test_the_gradient_that_is_told_is_that_of_the_best_point():
    """Assert it of an optimizer whose steps, a little too long, lead away from the guess."""
    far = fit(GUESS, RECORD, optimizer=optax.sgd(1e-3), max_iterations=1, **ASKED)
    best, last = far.history
    assert far.loss == best.loss < last.loss and best.gradient_norm != last.gradient_norm
    assert f"gradient norm {best.gradient_norm:.3g}" in str(far).splitlines()[0]


def _slope(path) -> float:
    return json.loads(path.read_text())["values"]["slope"]
