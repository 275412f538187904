"""Gradients of motions that are trivial: their steps are long, and what is differentiated is not.

At rest, in free flight and at zero control the error of a motion is 0, so its steps are chosen by nothing. The error
control of the derivative has to cut them.
"""

import pytest

from tests.problems.trivial_cases import CASES, FORWARD, REPLAY, assert_right


@pytest.mark.parametrize("method", [REPLAY, FORWARD])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case[0])
def test_a_trivial_motion_has_the_right_gradient(case, method):
    """Against the closed form, at a loose, the usual, and a tight tolerance."""
    assert_right(case, method)
