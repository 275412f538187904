"""P1 and P2 in the three forms that the sweep benchmarks compare, with the same random points for all."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import hybridsens
from hybridsens.scenes.shipped import parameter
from tests.problems import references


class Ball(hybridsens.AbstractScene):
    """P1: q'' = -g, gap q."""

    sustained_contact = False

    q0: eqx.Module = parameter(0.0)
    v0: eqx.Module = parameter(0.0)
    g: eqx.Module = parameter(0.0)
    e: eqx.Module = parameter(0.0)

    def start(self):
        return hybridsens.State(self.q0[None], self.v0[None])

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -self.g[None]

    def gap(self, t, q):
        return q

    def restitution(self):
        return self.e[None]


class Stop(hybridsens.AbstractScene):
    """P2: q'' = -omega^2 q - 2 zeta omega q' + A cos(Omega t), gap d - q, from rest."""

    sustained_contact = False

    omega: eqx.Module = parameter(0.0)
    zeta: eqx.Module = parameter(0.0)
    A: eqx.Module = parameter(0.0)
    Omega: eqx.Module = parameter(0.0)
    d: eqx.Module = parameter(0.0)
    e: eqx.Module = parameter(0.0)

    def start(self):
        return hybridsens.State(jnp.zeros(1), jnp.zeros(1))

    def mass_matrix(self, q):
        return jnp.eye(1)

    def force(self, t, q, v):
        return -(self.omega**2) * q - 2 * self.zeta * self.omega * v + self.A * jnp.cos(self.Omega * t)

    def gap(self, t, q):
        return self.d - q

    def restitution(self):
        return self.e[None]


class Problem(NamedTuple):
    """A scene, its horizon [s], and room for its events and steps at 1e-8 near the nominal parameters."""

    scene: Callable
    t1: float
    max_events: int
    max_steps: int


PROBLEMS = {"P1": Problem(Ball, 2.0, 8, 64), "P2": Problem(Stop, 20.0, 8, 448)}


def points(name: str, count: int, seed: int = 0) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters, and points within 1 % of their nominal values, (point, parameter)."""
    known = references.load(name)
    low, high = known.parameters * 0.99, np.minimum(known.parameters * 1.01, _highest(known.names))
    spread = np.random.default_rng(seed).random((count, len(known.parameters)))
    return known.names, np.minimum(low, high) + spread * abs(high - low)


def _highest(names) -> np.ndarray:
    return np.array([1.0 if name == "e" else np.inf for name in names])


def scenes(name: str, count: int):
    """The points as a batch of scenes."""
    names, values = points(name, count)
    return PROBLEMS[name].scene(**{key: values[:, i] for i, key in enumerate(names)})


def make_cost(name: str, tolerance: float = 1e-8) -> Callable:
    """J = int q^2 and the motion, for `hybridsens.sweep`."""
    problem = PROBLEMS[name]

    def cost(scene):
        trajectory = hybridsens.simulate(
            scene, scene.start(), t1=problem.t1, running_cost=lambda s, t, q, v: q @ q, rtol=tolerance, atol=tolerance,
            max_events=problem.max_events, max_steps=problem.max_steps, throw=False,
        )  # fmt: skip
        return trajectory.cost, trajectory

    return cost
