"""A held body that is let go where the curvature of its gap jumps: told of, and right where that place is a switch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import hybridsens as hs
from tests.closeness import assert_close

P = jnp.array([1.0, 0.5, 0.2, 0.1, 2.75])
"""Weight, radius of the edge, place of the edge, speed at the start, and the end of the motion."""


class Edge(hs.AbstractScene):
    """A disc that slides to the end of a plank, pushed by 0.3 of its weight."""

    weight: jax.Array
    radius: jax.Array
    tip: jax.Array

    def mass_matrix(self, q):
        return jnp.eye(2)

    def force(self, t, q, v):
        return jnp.stack([0.3 * self.weight, -self.weight])

    def gap(self, t, q):
        return hs.planar.to_segment(q, jnp.array([-3.0, 0.0]), jnp.stack([self.tip, 0 * self.tip]), self.radius)[None]

    def restitution(self):
        return jnp.zeros(1)


class EdgeWithSwitch(Edge, hs.AbstractSwitchedScene):
    """The same, with the place where the plank ends as a switch that changes nothing."""

    def force(self, t, q, v, mode):
        return super().force(t, q, v)

    def switches(self, t, q, v, mode):
        return (self.tip - q[0])[None]

    def switch(self, event, t, q, v, mode):
        return v, mode


def slide(scene, p, *mode, **given):
    start = hs.State(jnp.stack([jnp.array(-1.0), p[1]]), jnp.stack([p[3], 0 * p[3]]))
    return hs.simulate(scene(*p[:3]), start, *mode, t1=p[4], rtol=1e-10, atol=1e-10, max_events=8, **given)


def place(motion):
    return jnp.stack([motion.final.q[0], motion.final.q[1], motion.events.time[0]])


def closed_form(p):
    """Free flight begins at the edge, since the speed there is more than sqrt(weight radius)."""
    weight, radius, tip, speed, t1 = p
    left = (jnp.sqrt(speed**2 + 0.6 * weight * (tip + 1)) - speed) / (0.3 * weight)
    return jnp.stack([-1 + speed * t1 + 0.15 * weight * t1**2, radius - weight * (t1 - left) ** 2 / 2, left])


@pytest.mark.slow
def test_a_release_where_a_load_jumps_is_told():
    """Values are those of the closed form; of its derivative nothing is said but that."""
    with pytest.raises(hs.SimulationError, match="guard jumps below zero"):
        slide(Edge, P)
    motion = slide(Edge, P, throw=False)
    assert motion.status == hs.Status.guard_jumps and motion.status.reached_end
    assert motion.events.kind[0] == hs.EventKind.RELEASE
    assert_close(place(motion), closed_form(P), 1e-9)


METHODS = [
    pytest.param(hs.Replay(), id="reverse"),
    pytest.param(hs.ForwardSensitivities(), id="forward", marks=pytest.mark.slow),
]


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_switch_at_that_place_gives_the_derivative(method):
    """The release comes with the switch before it, by which its time moves: value and Jacobian of the closed form."""
    outcome = lambda p: place(slide(EdgeWithSwitch, p, jnp.array(0), adjoint=method))
    jacobian = jax.jacrev if isinstance(method, hs.Replay) else jax.jacfwd
    found, truth = jax.jit(jacobian(outcome))(P), jax.jacrev(closed_form)(P)
    assert np.abs(truth[:, 0]).min() > 0.1
    assert_close(found, truth, 1e-8)


class Rod(Edge):
    """A rod whose lower end slides over the edge too slowly to leave it: coordinates of its centre, and its angle."""

    def mass_matrix(self, q):
        return jnp.diag(jnp.array([1.0, 1.0, 0.2]))

    def force(self, t, q, v):
        return jnp.append(super().force(t, q, v), 0.0)

    def gap(self, t, q):
        return super().gap(t, q[:2] + 0.5 * jnp.stack([jnp.sin(q[2]), -jnp.cos(q[2])]))


def lean(p):
    """Where the rod ends, from weight, radius, edge, speed, and the angle at the start."""
    centre = jnp.stack([-0.3, p[1]]) - 0.5 * jnp.stack([jnp.sin(p[4]), -jnp.cos(p[4])])
    start = hs.State(jnp.append(centre, p[4]), jnp.stack([p[3], 0 * p[3], 0 * p[3]]))
    motion = hs.simulate(Rod(*p[:3]), start, t1=1.0, rtol=1e-10, atol=1e-10, max_events=4)
    return jnp.append(motion.final.q, motion.events.count)


@pytest.mark.slow
def test_a_contact_that_stays_held_there_has_its_derivative():
    """Only the load jumps, and what it does to the velocity is what the projection onto the gap takes: differences."""
    p, h = jnp.array([1.0, 1.5, 0.0, 0.5, 0.6]), 1e-3
    run = jax.jit(lean)
    sides = lambda k, way: run(p.at[k].add(h * way))
    by_differences = lambda k: (8 * (sides(k, 1) - sides(k, -1)) - (sides(k, 2) - sides(k, -2))) / (12 * h)
    assert run(p)[3] == 0
    found = jax.jit(jax.jacrev(lambda p: lean(p)[:3]))(p)
    assert_close(found, np.stack([by_differences(k)[:3] for k in range(5)], axis=1), 1e-8)
