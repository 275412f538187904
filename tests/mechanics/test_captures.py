"""Contacts that close and stay closed: at late clocks, and after neighbours kicked each other off."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems import scenes_at_random as at_random


class Dropped(hs.AbstractScene):
    """A body that is dropped on the floor and stays there, beside one that goes on swinging."""

    restitution_coefficient: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.stack([-9.81 * jnp.ones(()), -q[1]])

    def gap(self, t, q):
        return q[:1]

    def restitution(self):
        return self.restitution_coefficient[None]


@jax.jit
def drop(height, start, duration):
    """In one piece: the clock is rounded by 1e-8 s at 1e8 s, in which it falls by 1e-6 m."""
    state = hs.State(jnp.stack([height, jnp.ones(())]), jnp.zeros(2))
    scene, settings = Dropped(jnp.zeros(())), {"rtol": 1e-10, "atol": 1e-10}
    return hs.simulate(scene, state, t0=start, t1=start + duration, throw=False, **settings)


@pytest.mark.parametrize("start", [0.0, 1e6, 1e7, 1e8])
def test_a_body_stays_where_it_strikes_at_a_late_clock(start):
    """It is found below the floor by what it falls in one rounding of the clock, and no step is asked to mend that."""
    for height in 10 ** np.random.default_rng(4).uniform(-1, 3, 12):
        fall = np.sqrt(2 * height / 9.81)
        trajectory = drop(height, start, 2 * fall + 1)
        assert trajectory.status == hs.Status.successful
        assert trajectory.events.count == 1 and trajectory.events.kind[0] == hs.EventKind.CAPTURE
        rounded = 4e-16 * start
        assert abs(trajectory.events.time[0] - start - fall) < 1e-9 + 4 * rounded
        assert abs(trajectory.final.q[0]) < 1e-9 + 4 * rounded * 9.81 * fall
        assert_close(trajectory.final.v[0], 0.0, 1e-12, scale=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [46, 629, 2420, 4286])
def test_contacts_that_kick_each_other_off_come_to_rest_together(seed):
    """Two walls at an angle kicked a body off in turn, by less than rounding, until there was no room for events; of
    other scenes the last such kick was called grazing."""
    motion = at_random.move(*at_random.draw(seed))
    assert motion.status == hs.Status.successful
