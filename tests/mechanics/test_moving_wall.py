"""A wall moves by the clock: its gap is rounded as the clock is, however small the body's own coordinate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

T1 = 0.005


class Valve(hs.AbstractScene):
    """A cam lifts a valve off its seat, against a spring; lengths in `mm` and kg, s."""

    mass: jax.Array
    clearance: jax.Array
    speed: jax.Array
    late: jax.Array
    mm: jax.Array

    def mass_matrix(self, q):
        return self.mass * jnp.eye(1)

    def force(self, t, q, v):
        return -2e4 * q - 200 * self.mass * v - 2.5e5 * self.mm

    def profile(self, t):
        return 10 * self.mm * (0.5 * (1 - jnp.cos(self.speed * (t - self.late)))) ** 4

    def gap(self, t, q):
        return jnp.concatenate([q, q - self.profile(t) + self.clearance])

    def restitution(self):
        return jnp.array([0.3, 0.2])


@jax.jit
def ends(mass, clearance, speed, settings):
    """Where the valve ends, its derivative by the clearance, whether all went well, and its steps."""

    tolerance, late, mm = settings

    def end(clearance):
        start, times = hs.State([0.0], [0.0]), dict(t0=late, t1=late + T1)
        valve = Valve(mass, clearance, speed, late, mm)
        motion = hs.simulate(valve, start, **times, rtol=tolerance, atol=tolerance, throw=False)
        return motion.final.q[0], (motion.status == hs.Status.successful, motion.steps.accepted)

    (q, told), by_clearance = jax.value_and_grad(end, has_aux=True)(clearance)
    return q, by_clearance, *told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tolerance", "late", "mm"), [(1e-8, 0.0, 1.0), (1e-12, 0.0, 1.0), (1e-8, 1e6, 1.0), (1e-10, 0.0, 1e-3)]
)
def test_a_cam_takes_a_valve_along(tolerance, late, mm):
    """It strikes the valve, which bounces ever lower and is taken along: q = profile(t1) - clearance."""
    random = np.random.default_rng(0)
    masses, clearances, speeds = (random.uniform(*span, 20) for span in ((0.05, 0.15), (0.1, 0.3), (300.0, 500.0)))
    cams = zip(masses, clearances * mm, speeds, strict=True)
    found = [ends(*cam, (tolerance, late, mm)) for cam in cams]
    q, by_clearance, successful, steps = map(np.array, zip(*found, strict=True))
    assert successful.all() and steps.max() < 200
    lift = 10 * mm * (0.5 * (1 - np.cos(speeds * T1))) ** 4
    assert_close(q, lift - clearances * mm, within=1e-9 + 1e-12 * late)  # a late clock shows less of the cam
    assert_close(by_clearance, -np.ones(20), within=1e-9)
