"""Roots of the cubic through a guard's values and rates at the ends of a step."""

import jax.numpy as jnp
import pytest

from hybridsens.numerics.cubic import first_falling_root


def root_of(g0, d0, g1, d1):
    ends = [jnp.array([float(x)]) for x in (g0, d0, g1, d1)]
    return first_falling_root(*ends, jnp.zeros(1))[0][0]


@pytest.mark.parametrize("bend", [1e-4, -1e-4, 0.1, -0.1])
@pytest.mark.parametrize("root", [1e-9, 1e-6, 0.3, 1 - 1e-6, 1 - 1e-9])
def test_a_root_is_found_wherever_it_lies(root, bend):
    """c(s) = (root - s) (1 + bend s) falls through zero at `root`, also where that is all but an end of the step."""
    value = lambda s: (root - s) * (1 + bend * s)
    rate = lambda s: -(1 + bend * s) + (root - s) * bend
    found = root_of(value(0.0), rate(0.0), value(1.0), rate(1.0))
    assert abs(found - root) < 1e-15 + 1e-12 * min(root, 1 - root)
