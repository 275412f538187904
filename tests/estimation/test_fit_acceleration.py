"""Steps that bend: the correction against its closed form, and what it saves in a curved valley."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hybridsens.estimation import acceleration, least_squares
from hybridsens.estimation.descend import Limits, descend
from hybridsens.estimation.optimizers import chosen_method
from hybridsens.estimation.problem import Trial
from hybridsens.status import Status


class Valley:
    """Residuals (10 (z1 - z0^2), 1 - z0): the minimum lies at (1, 1), at the end of a curved valley."""

    at_stage_end = lambda self, end: self
    fails = False
    walls = 10
    data, t0, horizon = SimpleNamespace(times=np.zeros(0)), 0.0, 1.0

    def residuals(self, z, adjoint):
        del adjoint
        none = jnp.full(1, -1)
        r = jnp.stack([self.walls * (z[1] - z[0] ** 2), 1 - z[0]])
        return r, Trial(jnp.array(self.fails), Status.successful, none, none, jnp.array(jnp.inf))


class Canyon(Valley):
    """The same with steep walls."""

    walls = 1000


class Failing(Valley):
    """No motion reaches its end."""

    fails = True


def _geodesic(problem, z, damping, wanted=True):
    residuals = lambda z: problem.residuals(z, None)[0]
    r, jacobian = residuals(z), jax.jacfwd(residuals)(z)
    step = -jnp.linalg.solve(jacobian.T @ jacobian + damping * jnp.eye(2), jacobian.T @ r)
    geodesic = acceleration.geodesic(problem, z, step, r, jacobian, jnp.asarray(damping), jnp.asarray(wanted))
    return step, geodesic, jacobian


def test_a_step_bends_by_the_closed_form():
    """Assert step + a / 2 with (J^T J + damping) a = -J^T r_vv and r_vv = (-20 step_0^2, 0)."""
    step, geodesic, jacobian = _geodesic(Valley(), jnp.array([0.5, 0.9]), 1.0)
    second = jnp.array([-20 * step[0] ** 2, 0.0])
    a = -jnp.linalg.solve(jacobian.T @ jacobian + jnp.eye(2), jacobian.T @ second)
    assert 0 < np.linalg.norm(a) < 0.75 * np.linalg.norm(step)
    np.testing.assert_allclose(geodesic, step + a / 2, rtol=1e-10)


@pytest.mark.parametrize("problem, damping, wanted", [(Valley(), 1e-6, True), (Failing(), 1.0, True),
                                                      (Valley(), 1.0, False)])  # fmt: skip
def test_a_step_stays_straight(problem, damping, wanted):
    """Assert no correction where it would be larger than a parabola can tell, where the probe fails, and unasked."""
    step, geodesic, _ = _geodesic(
        problem, jnp.array([-1.2, 1.0]) if damping < 1e-3 else jnp.array([0.5, 0.9]), damping, wanted
    )
    np.testing.assert_array_equal(geodesic, step)


@pytest.mark.slow
def test_fewer_iterations_in_a_curved_valley(monkeypatch):
    """Assert that the end of a canyon is reached in at most a fifth of the iterations of straight steps (55, 637)."""

    def iterations(rtol):  # two settings, so that nothing compiled is shared
        how = chosen_method(least_squares.LevenbergMarquardt(rtol))
        done = descend(how, Canyon(), jnp.array([-1.2, 1.0]), Limits(1000, 500))
        np.testing.assert_allclose(done.z, [1, 1], atol=1e-4)
        return len(done.history) - 1

    bending = iterations(1e-6)
    monkeypatch.setattr(least_squares, "geodesic", lambda problem, z, step, *rest: step)
    assert 5 * bending <= iterations(1.1e-6)
