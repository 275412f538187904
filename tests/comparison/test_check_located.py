"""`check_gradient` knows which comparisons are events."""

import jax
import jax.numpy as jnp
import pytest

import hybridsens as hs
from hybridsens.comparison.check_motions import _undeclared_breaks


class Rubbed(hs.AbstractScene):
    """A spring with dry friction and a soft bumper."""

    located_discontinuities = True
    friction: jax.Array
    stiffness: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.stiffness * (q + 9 * jnp.maximum(q - 0.3, 0)) - self.friction * jnp.sign(v)

    def gap(self, t, q):
        return q + 0.5

    def restitution(self):
        return jnp.array([0.7])


class Saturated(hs.AbstractHybridSystem):
    located_discontinuities = True

    def flow(self, t, x, mode):
        return jnp.clip(jnp.sin(t), -0.5, 0.5) - jnp.sort(jnp.stack([x, t, 1.0]))[1]

    def guards(self, t, x, mode):
        return jnp.zeros(0)

    def transition(self, event, t, x, mode):
        return x, mode


@pytest.mark.slow
def test_comparisons_that_are_events_leave_nothing_in_doubt():
    """Before: the determinant at the jump of the friction, which is no impact, was wanted to be 1."""

    def cost(scene, simulate):
        return simulate(scene, hs.State([0.5], [0.0]), t1=2.0).final.q[0]

    check = hs.check_gradient(Rubbed(jnp.array(0.03), jnp.array(4.0)), cost)
    assert any(event.kind == hs.EventKind.SWITCH for event in check.events)
    assert check.ok


def test_comparisons_that_are_events_are_no_cause():
    """What no event tells of is still one."""
    start = hs.State(jnp.array([0.2]), jnp.zeros(1))
    breaks = lambda *given: _undeclared_breaks(*given, (), jnp.array(0.0), None, None)
    assert breaks(Rubbed(jnp.array(0.03), jnp.array(4.0)), start) == ()
    assert [found.operation for found in breaks(Saturated(), jnp.array(0.2))] == ["jnp.sort"]
