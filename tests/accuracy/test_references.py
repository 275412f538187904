"""Values and gradients of the reference problems meet their digits, which hold from 25 places on."""

import functools

import numpy as np
import pytest

from tests.closeness import assert_close
from tests.problems.reference_scenes import bouncing_ball, cylinder_slide, elastic_stop, stacked_balls
from tests.problems.references import RECORDS
from tests.problems.shipped_motions import solve_with_gradient

# Scene, and what of (cost, final q, final v) the digits are for.
PROBLEMS = {
    "P1": (bouncing_ball, lambda seen: [seen.final[0], seen.cost]),
    "P2": (elastic_stop, lambda seen: [seen.cost]),
    "P2b": (elastic_stop, lambda seen: [seen.cost]),
    "P3": (cylinder_slide, lambda seen: [seen.final[0], seen.final[1]]),
    "P4": (stacked_balls, lambda seen: [seen.final[1]]),
}
# Relative errors allowed in value and gradient. P3 starts almost at balance, which magnifies errors.
ALLOWED = {1e-8: (2e-8, 1e-7), 1e-12: (2e-12, 2e-11)}
ALLOWED_P3_GRADIENT = {1e-8: 2e-6, 1e-12: 5e-10}


@functools.cache
def solved(name, tolerance):
    """What is observed, its gradient by the problem's parameters, and the trajectory."""
    return solve_with_gradient(PROBLEMS[name][0], RECORDS[name]["p"], RECORDS[name]["T"], tolerance)


@pytest.mark.parametrize("tolerance", ALLOWED)
@pytest.mark.parametrize("name", PROBLEMS)
def test_value_and_gradient_meet_the_digits(name, tolerance):
    """Every functional, and its gradient by every parameter."""
    seen, jacobian, _ = solved(name, tolerance)
    record, functionals = RECORDS[name], PROBLEMS[name][1]
    value_within, gradient_within = ALLOWED[tolerance]
    gradient_within = ALLOWED_P3_GRADIENT[tolerance] if name == "P3" else gradient_within
    for value, gradient, J, dJ in zip(functionals(seen), functionals(jacobian), record["J"], record["dJ"], strict=True):
        assert_close(value, float(J), value_within)
        assert_close(gradient, np.array(dJ, float), gradient_within)


@pytest.mark.parametrize("name", PROBLEMS)
def test_event_times_meet_the_digits(name):
    """How many events there are, when each is, and how the first one's time moves with every parameter."""
    _, jacobian, trajectory = solved(name, 1e-12)
    record = RECORDS[name]
    times = np.array(record["events"], float)
    within = 1e-9 if name == "P3" else 1e-11
    assert trajectory.events.count == record["n_events"]
    assert_close(trajectory.events.time[: len(times)], times, within)
    assert_close(jacobian.time[0], np.array(record["dt_first"], float), 50 * within)


def test_no_digits_are_lost_at_an_event():
    """Steps land on events, so flights that a step integrates exactly give exact gradients at a loose tolerance."""
    _, jacobian, _ = solved("P1", 1e-8)
    assert_close(jacobian.cost, np.array(RECORDS["P1"]["dJ"][1], float), 1e-10)
