"""Where `check_gradient` cannot decide, it says why, and blames no derivative."""

import importlib

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.comparison.check_causes import find_causes
from hybridsens.comparison.check_report import ParameterCheck

check_gradient_module = importlib.import_module("hybridsens.comparison.check_gradient")
ROOM = dict(max_events=8, max_steps=1024)


class Driven(hs.AbstractScene):
    """A mass without contacts, under a force that is constant between knots."""

    knots: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return jnp.array([0.5, -0.2, 0.7])[jnp.searchsorted(self.knots, t, side="right") - 1][None]

    def gap(self, t, q):
        return jnp.zeros(0)

    def restitution(self):
        return jnp.zeros(0)

    def jump_times(self):
        return self.knots


@pytest.mark.slow
def test_a_jump_time_at_the_start_is_told():
    """For the least change of the first knot the force begins before the motion or in it."""
    end = lambda scene, simulate: simulate(scene, hs.State([1.0], [0.0]), t1=1.0).final.q[0]
    check = hs.check_gradient(Driven(jnp.array([0.0, 0.3, 0.6])), end, **ROOM)
    assert [entry.parameter for entry in check.parameters if entry.verdict] == ["knots[0]"], str(check)
    assert [cause.kind for cause in check.causes] == ["jump time at an end"], str(check)


def test_differences_that_do_not_decide_blame_no_derivative():
    doubt = ParameterCheck("height", 1.0, 1.0, 1.1, 0.2, 1.0, "not decided: differences are uncertain by 2.0e-01")
    (cause,) = find_causes([doubt], [], [], {}, {})
    assert cause.kind == "undecided" and "both gradient methods" in cause.remedy
