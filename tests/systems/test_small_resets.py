"""A reset that is small beside what the state once was: made, or told of, but never lost."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close


class Refilled(hs.AbstractHybridSystem):
    """x' = -x; where x falls through 1 it is put back by `back`."""

    back: jax.Array

    def flow(self, t, x, mode):
        return -x

    def guards(self, t, x, mode):
        return (x - 1)[None]

    def transition(self, event, t, x, mode):
        return x + self.back, mode + 1


@jax.jit
def refilled(start, back):
    """Where x is, and how often it was put back, between the third time and the fourth; and the status."""
    t1 = jnp.log(start) + 2.5 * jnp.log1p(back)
    rough = start.dtype == jnp.float32
    solution = hs.solve(Refilled(back), start, 0, t1=t1, rtol=1e-5 if rough else 1e-10, atol=1e-10, throw=False)
    return solution.final, solution.mode, solution.status


@pytest.mark.parametrize(("start", "back"), [(1e3, 1e-5), (1e6, 1e-2), (1e9, 0.5)])
def test_it_is_made(start, back):
    final, count, status = refilled(jnp.array(start), jnp.array(back))
    assert status == hs.Status.successful and count == 3
    assert_close(final, np.sqrt(1 + back), within=1e-7)  # some hundred steps from 1e9 to 1, each right to 1e-10 or so


@pytest.mark.parametrize(
    ("dtype", "start", "back"),
    [(float, 1e9, 1e-2), (float, 1e12, 1e-4), (float, 1e12, 0.5), (np.float32, 1e4, 0.1), (np.float32, 1e5, 0.5)],
)
@pytest.mark.filterwarnings("ignore:An `rtol` below")
def test_what_rounding_of_the_start_hides_is_told(dtype, start, back):
    """It was taken for a section that is passed: one event, value and gradient wrong, without a word."""
    assert refilled(jnp.asarray(start, dtype), jnp.asarray(back, dtype))[2] == hs.Status.reset_unclear


class Watched(Refilled):
    """Where x falls through 1 nothing changes."""

    def transition(self, event, t, x, mode):
        return x * (1 + self.back), mode + 1


@pytest.mark.parametrize("rounded", [0.0, 1e-15])
def test_a_section_is_passed_however_large_the_state_was(rounded):
    solution = hs.solve(Watched(jnp.array(rounded)), 1e9, 0, t1=25.0)
    assert solution.mode == 1
    assert_close(solution.final, 1e9 * np.exp(-25.0), within=1e-6)
