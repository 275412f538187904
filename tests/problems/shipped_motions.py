"""Shipped scenes as functions of a flat vector of parameters, each compiled once for the whole suite."""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

import hybridsens as hs
from hybridsens.scenes import (
    BouncingBall,
    CylinderSlide,
    DoublePendulumWall,
    ElasticStop,
    PendulumWall,
    StackedBalls,
    VibratingTable,
)

MAX_EVENTS = 64
REPORTED = {
    BouncingBall: 10,
    CylinderSlide: 6,
    DoublePendulumWall: 2,
    ElasticStop: 5,
    PendulumWall: 5,
    StackedBalls: 4,
    VibratingTable: 8,
}
"""Events whose derivatives are looked at; each is as many rows of a Jacobian."""


class Inputs(NamedTuple):
    """Everything that a motion is differentiated by."""

    parameters: Array
    """The scene's fields, in their order."""
    shift: Array
    """Added to the initial (q, v)."""
    t1: Array


class Observed(NamedTuple):
    """Everything that is differentiated; rows beyond the last event are zero."""

    cost: Array
    final: Array
    """(q, v) at t1."""
    time: Array
    before: Array
    """(q, v) just before each event."""
    after: Array
    impulse: Array
    closing_speed: Array


def names(scene_class) -> list[str]:
    """Names of a scene's parameters."""
    return [field.name for field in dataclasses.fields(scene_class)]


def inputs(scene, t1=None, shift=None) -> Inputs:
    """A scene as a point in the space that motions are differentiated in."""
    parameters = jnp.stack([getattr(scene, name) for name in names(type(scene))])
    dof = scene.initial_state().q.shape[0]
    shift = jnp.zeros(2 * dof) if shift is None else jnp.asarray(shift, float)
    return Inputs(parameters, shift, jnp.asarray(scene.t1 if t1 is None else t1, float))


def run(scene_class, x: Inputs, tolerance, **settings) -> hs.Trajectory:
    """The motion at one such point."""
    scene = scene_class(**dict(zip(names(scene_class), x.parameters, strict=True)))
    start = scene.initial_state()
    q, v = jnp.split(jnp.concatenate([start.q, start.v]) + x.shift, 2)
    settings = dict(max_events=MAX_EVENTS, throw=False, rtol=tolerance, atol=tolerance) | settings
    return hs.simulate(scene, hs.State(q, v), t1=x.t1, running_cost=type(scene).running_cost, **settings)


def observe(trajectory: hs.Trajectory, count: int) -> Observed:
    """The differentiable part of a trajectory, with its first `count` events."""
    events = trajectory.events
    happened = jnp.arange(count) < events.count
    rows = lambda values: jnp.where(happened.reshape(-1, *[1] * (values.ndim - 1)), values[:count], 0)
    flat = lambda state: jnp.concatenate([state.q, state.v], axis=-1)
    return Observed(
        trajectory.cost, flat(trajectory.final), rows(events.time), rows(flat(events.before)), rows(flat(events.after)),
        rows(events.impulse), rows(events.closing_speed),
    )  # fmt: skip


@functools.cache
def reverse(scene_class):
    """(inputs, tolerance) -> (Jacobian of Observed by Inputs, (Observed, Trajectory)), by the jump adjoint."""

    def observed(x, tolerance):
        trajectory = run(scene_class, x, tolerance)
        seen = observe(trajectory, REPORTED[scene_class])
        return seen, (seen, trajectory)

    return jax.jit(jax.jacrev(observed, has_aux=True))


@functools.cache
def forward(scene_class):
    """The Jacobian of `reverse`, by forward sensitivities with saltation matrices."""

    def observed(x, tolerance):
        trajectory = run(scene_class, x, tolerance, adjoint=hs.ForwardSensitivities())
        return observe(trajectory, REPORTED[scene_class])

    return jax.jit(jax.jacfwd(observed))


def solve(scene, tolerance, t1=None, shift=None) -> tuple[Observed, Observed, hs.Trajectory]:
    """What is observed of a scene's motion, its Jacobian, and the whole trajectory."""
    jacobian, (seen, trajectory) = reverse(type(scene))(inputs(scene, t1, shift), jnp.asarray(tolerance))
    assert trajectory.status == hs.Status.successful, hs.Status[trajectory.status]
    return seen, jacobian, trajectory


def chain(jacobian: Observed, scene_of, p) -> Observed:
    """Jacobian of Observed by p, where p is what a scene is made from: `inputs(*scene_of(p))`."""
    inner = jax.jacfwd(lambda p: inputs(*scene_of(p)))(jnp.asarray(p, float))
    through = lambda outer: sum(
        jnp.tensordot(of, by, axes=(-by.ndim + 1, 0)) if by.ndim > 1 else of[..., None] * by
        for of, by in zip(outer, inner, strict=True)
    )
    return Observed(*(through(outer) for outer in jacobian))


def solve_with_gradient(scene_of, p, t1, tolerance) -> tuple[Observed, Observed, hs.Trajectory]:
    """What is observed of the scene made from p, its Jacobian by p, and the trajectory."""
    seen, jacobian, trajectory = solve(scene_of(*p), tolerance, t1)
    return seen, chain(jacobian, lambda p: (scene_of(*p), t1), p), trajectory
