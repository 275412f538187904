"""Gradients of motions that are trivial: their steps are long, and what is differentiated is not.

At rest, in free flight and at zero control the error of a motion is 0, so its steps are chosen by nothing. The error
control of the derivative has to cut them.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close
from tests.problems import trivial_motions as motions
from tests.problems.trivial_cases import CASES, FORWARD, REPLAY, assert_right

QUICK = {REPLAY: (motions.springs, motions.ball, motions.held), FORWARD: (motions.springs,)}
"""Other scenes are in the slow suite."""


def each_by_both():
    """Every case by reverse and by forward mode."""
    for case in CASES:
        for method in (REPLAY, FORWARD):
            slow = [] if case[1] in QUICK[method] else [pytest.mark.slow]
            yield pytest.param(case, method, id=f"{case[0]}-{method}", marks=slow)


@pytest.mark.parametrize(("case", "method"), list(each_by_both()))
def test_a_trivial_motion_has_the_right_gradient(case, method):
    """Against the closed form, at a loose, the usual, and a tight tolerance."""
    assert_right(case, method)


class Spring(hs.AbstractScene):
    """q'' = -q, far above its floor."""

    mass: jax.Array

    def mass_matrix(self, q):
        return self.mass * jnp.eye(1)

    def force(self, t, q, v):
        return -q

    def gap(self, t, q):
        return q + 100

    def restitution(self):
        return jnp.ones(1)


@pytest.mark.slow
def test_a_time_sampled_twice_inside_a_cut_step():
    """At rest the recorded steps are cut, here between two samples at one time: dq(t)/dv0 = sin t for each."""
    ts = jnp.array([3.0, 3.0, 7.3])

    def cost(v):
        motion = hs.simulate(Spring(jnp.array(1.0)), hs.State(jnp.zeros(1), v[None]), t1=10.0, ts=ts)
        return jnp.array([1.0, 10.0, 100.0]) @ motion.q[:, 0]

    exact = np.array([1.0, 10.0, 100.0]) @ np.sin(ts)
    assert_close(jax.grad(cost)(jnp.array(0.0)), exact, 1e-6)
