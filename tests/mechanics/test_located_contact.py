"""Contacts that are held closed where a comparison changes their gap: corners and seams, against closed forms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

import hybridsens

GRAVITY = 9.81
START = hybridsens.State([-0.2, 0.0], [1.0, 0.0])
"""A body on a floor, 0.2 before the place where its ground changes."""


class Ground(hybridsens.AbstractScene):
    """A body that stays on the ground where it can: a floor, and beyond x = 0 something else."""

    located_discontinuities = True
    steepness: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.array([0.0, -GRAVITY])

    def gap(self, t, q):
        return (q[1] - jnp.where(q[0] > 0, self.height(q[0]), 0.0))[None]

    def height(self, x):
        return self.steepness * x

    def restitution(self):
        return jnp.zeros(1)


class Bowl(Ground):
    """The ground rises without a corner."""

    def height(self, x):
        return self.steepness * x**2


def final(ground, t1, **options):
    motion = hybridsens.simulate(ground, START, t1=t1, **options)
    return motion.final.q[0], motion


def along_the_slope(steepness, t1):
    """Place beyond the corner: the body loses the part of its velocity across the slope there, where the slope rises;
    where it falls, the body flies first, and loses that part where it lands."""
    flight = max(0.0, -2 * steepness / GRAVITY)
    across = 1 + steepness**2
    speed = (1 - steepness * GRAVITY * flight) / across
    rest = t1 - 0.2 - flight
    return flight + speed * rest - GRAVITY * steepness / across * rest**2 / 2


VALLEY, EDGE = pytest.param(0.3, id="valley", marks=pytest.mark.slow), pytest.param(-0.3, id="edge")


@pytest.mark.parametrize("steepness", [VALLEY, EDGE])
def test_a_body_goes_round_a_corner(steepness):
    value_and_gradient = eqx.filter_value_and_grad(final, has_aux=True)
    (x, motion), gradient = value_and_gradient(Ground(steepness), 0.4)
    difference = (along_the_slope(steepness + 1e-5, 0.4) - along_the_slope(steepness - 1e-5, 0.4)) / 2e-5
    assert float(x) == pytest.approx(along_the_slope(steepness, 0.4), abs=1e-12)
    assert float(gradient.steepness) == pytest.approx(difference, rel=1e-8)
    assert bool(motion.mode[0]) and float(motion.final.q[1]) == pytest.approx(steepness * float(x), abs=1e-12)


def time_to(x, steepness):
    """From energy: (1 + 4 k^2 x^2) x'^2 = 1 - 2 g k x^2 on y = k x^2."""
    slowness = lambda x: np.sqrt((1 + (2 * steepness * x) ** 2) / (1 - 2 * GRAVITY * steepness * x**2))
    return 0.2 + quad(slowness, 0, x, epsabs=1e-14, epsrel=1e-14)[0]


@pytest.mark.slow
@pytest.mark.parametrize("tolerance, steepness", [(1e-8, 1e-4), (1e-5, 0.1)])
def test_a_body_stays_on_a_ground_that_rises_without_a_corner(tolerance, steepness):
    """It went straight on, through the ground, in steps of a millionth."""
    value_and_gradient = eqx.filter_value_and_grad(final, has_aux=True)
    (x, motion), gradient = value_and_gradient(Bowl(steepness), 0.6, rtol=tolerance, atol=tolerance)
    x = float(x)
    by_place = (time_to(x + 1e-5, steepness) - time_to(x - 1e-5, steepness)) / 2e-5
    width = 1e-3 * steepness
    by_steepness = (time_to(x, steepness + width) - time_to(x, steepness - width)) / (2 * width)
    assert time_to(x, steepness) == pytest.approx(0.6, abs=tolerance)
    assert float(motion.final.q[1]) == pytest.approx(steepness * x**2, abs=1e-12)
    assert float(gradient.steepness) == pytest.approx(-by_steepness / by_place, abs=10 * tolerance, rel=1e-6)
    assert int(motion.steps.accepted) < 30
