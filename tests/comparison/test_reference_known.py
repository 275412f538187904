"""No error is told that is smaller than what the reference itself is known to."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.comparison.compare import Reference, tight_reference
from hybridsens.comparison.differentiate import central_differences
from hybridsens.comparison.functional import ready_made_motion
from hybridsens.parameters import flatten_parameters
from hybridsens.scenes import BouncingBall

TIGHT = dict(max_events=64, max_steps=4096)


class Logistic(hs.AbstractHybridSystem):
    """Growth in closed form, and the chaotic map at every full second: errors double with each of them."""

    rate: jax.Array
    maps: int = 36

    def flow(self, t, x, mode):
        return self.rate * x * (1 - x)

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def scheduled_times(self, x, mode):
        return jnp.arange(1.0, self.maps + 1)

    def transition(self, event, t, x, mode):
        return 3.99 * x * (1 - x), mode


def _end(system, solve):
    return solve(system, 0.2345, t1=system.maps + 0.5).final


def test_a_chaotic_reference_says_how_little_it_knows():
    """Assert that its error covers the true one, by a motion 60 digits long, and that no point is recommended for
    less: the reference's own run was, for any error."""
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workdps(60):
        x = mpmath.mpf(0.2345)
        for _ in range(36):
            grown = x * mpmath.e ** mpmath.mpf(0.3)
            x = grown / (1 - x + grown)
            x = mpmath.mpf(3.99) * x * (1 - x)
        grown = x * mpmath.e ** (mpmath.mpf(0.3) / 2)
        truth = float(grown / (1 - x + grown))
    study = hs.work_precision(
        Logistic(0.3), _end, solvers=[diffrax.Dopri8()], tolerances=[1e-13], methods=[hs.Replay()], progress=False
    )
    reference = study.reference
    assert 1e-9 < abs(reference.value / truth - 1) < 10 * reference.value_error
    assert study.points[0].is_reference and study.recommend(1e-3 * reference.gradient_error) is None
    assert study.recommend(2 * reference.gradient_error) == study.points[0]
    assert "known to" in str(study) and "gradient error 1e-08 on this scene: the reference is not known" in str(study)


@pytest.mark.slow
def test_a_cost_at_its_minimum_is_rounding():
    """Assert that the reference says so, in a table too, and that it says nothing of a cost that is not."""
    ball = BouncingBall()
    cost = lambda scene, simulate: ready_made_motion(scene, simulate).cost
    known = tight_reference(flatten_parameters(ball), cost, TIGHT)
    assert known.remark == "" and 0 < known.gradient_error < 1e-8
    seen = np.nextafter(known.value, np.inf)
    square = lambda scene, simulate: (cost(scene, simulate) - seen) ** 2
    least = tight_reference(flatten_parameters(ball), square, TIGHT)
    assert least.gradient_error > 0.1 and "no smaller error is told" in str(hs.Comparison((), least, ()))
    assert Reference(1.0, np.ones(1)).remark == ""


def test_a_parameter_much_smaller_than_a_step_has_differences():
    """Where one of the usual width leads out of its range on both sides."""
    function = lambda p: (3e8 * p[0] ** 2, jnp.abs(p[0] - 1e-9) < 1e-10)
    value, gradient, _ = central_differences(function, bool)(jnp.array([1e-9]))
    assert gradient[0] == pytest.approx(0.6, rel=1e-6)
