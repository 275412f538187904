"""Walls at a small angle: the rates of their gaps are small while a body passes fast."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from hybridsens.mechanics.decisions import ImpactDetail
from hybridsens.mechanics.mode import EventKind, open_mode
from hybridsens.mechanics.system import Decision, MechanicalSystem
from tests.problems.flat_contacts import make

GRAVITY, HEIGHT, AFTER = 9.81, 1.0, 2.0


def valley(angle):
    """Two planes that meet at the origin, each rising at this angle."""
    normals = [[np.sin(angle), np.cos(angle)], [-np.sin(angle), np.cos(angle)]]
    return make([1.0, 1.0], [0.0, -GRAVITY], normals, [0.0, 0.0], [0.0, 0.0])


def vertex_time(angle, x):
    """When the ball that is dropped at x < 0 passes the vertex, and how fast: it falls on a plane and slides."""
    fall = jnp.sqrt(2 * (HEIGHT + jnp.tan(angle) * x) / GRAVITY)
    pull, way = GRAVITY * jnp.sin(angle), -x / jnp.cos(angle)
    speed = jnp.sqrt((pull * fall) ** 2 + 2 * pull * way)
    return speed / pull, speed


def place(angle, x, t1):
    """Where the ball is then. The other plane takes of its speed what points into it, and leaves cos(2 angle) of it."""
    passed, speed = vertex_time(angle, x)
    left = t1 - passed
    return jnp.cos(angle) * (jnp.cos(2 * angle) * speed * left - GRAVITY * jnp.sin(angle) * left**2 / 2)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [1e-2, 1e-4])
def test_a_ball_passes_a_shallow_vertex(angle):
    """Its gap to either plane changes slower than a rebound that is neglected, but the ball has far more speed."""
    x = jnp.array(-0.05)
    t1 = vertex_time(angle, x)[0] + AFTER * angle**0.5

    def end(x):
        state = hs.State(jnp.stack([x, HEIGHT]), jnp.zeros(2))
        return hs.simulate(valley(angle), state, t1=t1, max_events=64).final.q[0]

    found, slope = jax.jit(jax.value_and_grad(end))(x)
    expected, derivative = jax.value_and_grad(lambda x: place(angle, x, t1))(x)
    assert abs(found - expected) < 1e-8 and abs(slope / derivative - 1) < 1e-6


@pytest.mark.parametrize("walls", [4, 9])
def test_a_contact_that_is_struck_and_brought_to_rest_rests(walls):
    """Also where it is the only one that takes part, out of so many that one is looked at alone."""
    scene = make([1.0], [0.0], np.ones((walls, 1)), np.zeros(walls), np.full(walls, 0.5))
    system = MechanicalSystem(scene, None, 1e-5, 1, (1e-8, 1e-8))
    struck, nobody = jnp.arange(walls) == 2, jnp.zeros(walls, bool)
    detail = ImpactDetail(struck, struck, nobody, struck)
    decision = Decision(open_mode(walls, float), jnp.asarray(EventKind.CAPTURE), detail)
    after, _ = system.reset(decision, jnp.array(0.0), jnp.array([0.0, -1.0]))
    assert abs(after[1]) < 1e-15
