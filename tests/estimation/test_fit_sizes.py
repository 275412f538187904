"""A guess of 0 tells no size: fits find it, in any unit. And what is kept of many starts when Ctrl-C comes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.estimation import fit, starts
from hybridsens.estimation.least_squares import at_minimum
from tests.problems.sawtooth import Sawtooth

TIMES = np.linspace(0.05, 0.4, 8)
RECORD = {"t": TIMES, "x": 1 - 2 * TIMES + 0.01 * np.cos(40 * TIMES), "sigma_x": np.full(8, 0.01)}
SLOPE = float(TIMES @ (1 - RECORD["x"]) / (TIMES @ TIMES))
"""The best one, of a line through (0, 1)."""
ROOM = dict(max_events=4, max_steps=64)


class Faster(Sawtooth):
    """A sawtooth with some more slope, counted in another unit."""

    more: jax.Array
    unit: jax.Array

    def flow(self, t, x, mode):
        return -self.slope - self.unit * self.more


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1e9])
def test_a_guess_of_0_is_left_in_any_unit(unit, tmp_path):
    """Assert the minimum of the linear problem, also where its value is 1e-9: the fit said "converged" at 0."""
    guess, kept = Faster(1.2, 1.0, 0.0, unit), dict(parameters="more", store=tmp_path / "best.json")
    found = fit(guess, RECORD, **kept, **ROOM)
    assert found.converged and found.values[0] * unit == pytest.approx(SLOPE - 1.2, rel=1e-6)
    again = fit(guess, RECORD, **kept, **ROOM)  # from the store
    assert again.converged and again.values[0] * unit == pytest.approx(SLOPE - 1.2, rel=1e-6)


@pytest.mark.parametrize("bounds", [None, {"more": "positive"}], ids=["free", "positive"])
@pytest.mark.slow
def test_a_guess_next_to_0_is_left_too(bounds):
    """From 1e-12, which does nothing that residuals show: the fit said "converged" there."""
    found = fit(Faster(1.2, 1.0, 1e-12, 1.0), RECORD, parameters="more", bounds=bounds, **ROOM)
    assert found.converged and found.values[0] == pytest.approx(SLOPE - 1.2, rel=1e-5)


@pytest.mark.parametrize("unit", [1.0, pytest.param(1e9, marks=pytest.mark.slow)])
def test_a_guess_on_its_bound_begins_inside_by_its_size(unit):
    """Where it began a millionth inside, whatever its size, the fit crept along a plateau."""
    found = fit(Faster(1.2, 1.0, 0.0, unit), RECORD, parameters="more", bounds={"more": "positive"}, **ROOM)
    assert found.converged and found.values[0] * unit == pytest.approx(SLOPE - 1.2, rel=1e-5)
    assert 0.01 < found.guess[0] * unit < 1 and found.iterations < 10


@pytest.mark.slow
def test_a_guess_of_0_that_is_right_is_where_the_fit_ends():
    """Assert that no size is made of residuals that are rounding."""
    exact = {"t": TIMES, "x": 1 - 2 * TIMES}
    found = fit(Faster(2.0, 1.0, 0.0, 1.0), exact, parameters="more", **ROOM)
    assert found.converged and abs(found.values[0]) < 1e-12


def test_a_large_unknown_does_not_hide_that_a_small_one_moves():
    """Assert that a step of a thousandth of one is none of a minimum, however large the other one is."""
    r, slope = jnp.array([0.0, 1e-3, 0.0]), jnp.eye(3)[:, :2]
    assert not at_minimum(r, slope, jnp.array([1e9, 1.0]), 3)
    assert at_minimum(1e-9 * r, slope, jnp.array([1e9, 1.0]), 3)


def test_a_short_column_counts_as_a_long_one_does():
    """Assert that residuals along it are told, unless it is rounding of the other one."""
    r, z, slope = jnp.array([0.0, 1.0, 0.1]), jnp.ones(2), lambda short: jnp.array([[1.0, 0], [0, short], [0, 0]])
    assert not at_minimum(r, slope(1e-12), z, 3) and at_minimum(r, slope(1e-16), z, 3)


@pytest.mark.slow
def test_ctrl_c_leaves_the_starts_that_have_finished(tmp_path, monkeypatch, capsys):
    """Assert that the best of two is returned, kept and told of."""
    descend, calls = starts._descend, []

    def interrupted(*arguments):
        calls.append(arguments)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return descend(*arguments)

    monkeypatch.setattr(starts, "_descend", interrupted)
    path = tmp_path / "best.json"
    guess = Faster(1.2, 1.0, 0.6, 1.0)
    found = fit(guess, RECORD, parameters="more", starts=5, store=path, progress=True, **ROOM)
    assert found.stopped == "interrupted" and found.starts.loss.shape == (2,)
    assert found.values[0] == pytest.approx(SLOPE - 1.2, rel=1e-6) and path.exists()
    assert "start 2 of 5" in capsys.readouterr().out
