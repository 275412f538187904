"""The least-squares problem of a fit with other derivatives, or another motion, in the place of this package's."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from hybridsens import Status
from hybridsens.adjoint.methods import Replay
from hybridsens.comparison.baselines import where_reset
from hybridsens.estimation.problem import Problem
from hybridsens.mechanics.scene import State


class DifferencesProblem(Problem):
    """The same residuals; their derivatives are differences of the motion."""

    step: float = eqx.field(static=True, default=1e-4)
    """Of z, which is of size 1. The motion's own error of 1e-8 spoils differences over much less than its root."""
    central: bool = eqx.field(static=True, default=False)

    def residuals(self, z, adjoint):
        del adjoint

        @jax.custom_jvp
        def residuals(z):
            return Problem.residuals(self, z, Replay())

        @residuals.defjvp
        def _(primals, tangents):
            (z,), (direction,) = primals, tangents
            r, trial = Problem.residuals(self, z, Replay())
            same_part = self.at_stage_end(trial.end)
            ahead, there = Problem.residuals(same_part, z + self.step * direction, Replay())
            behind = r
            if self.central:
                behind, _ = Problem.residuals(same_part, z - self.step * direction, Replay())
            slope = jnp.where(there.failed, jnp.nan, (ahead - behind) / (2 * self.step if self.central else self.step))
            return (r, trial), (slope, jax.tree.map(_no_tangent, trial))

        return residuals(z)


def _no_tangent(leaf):
    moves = jnp.issubdtype(leaf.dtype, jnp.inexact)
    return jnp.zeros(leaf.shape, leaf.dtype if moves else jax.dtypes.float0)


class NaiveEvents(NamedTuple):
    """Nobody knows the events of a fixed-step loop."""

    kind: Array
    contact: Array
    time: Array


class NaiveSamples(NamedTuple):
    """As much of a trajectory as residuals ask for."""

    q: Float[Array, "sample dof"]
    v: Float[Array, "sample dof"]
    status: Status
    events: NaiveEvents


class NaiveProblem(Problem):
    """The motion by fixed steps whose impacts are a `where`, differentiated by plain autodiff."""

    steps: int = eqx.field(static=True, default=100)
    """From sample to sample."""

    def motion(self, scene, adjoint):
        del adjoint
        ends = jnp.minimum(self.data.times, self.motion_end)
        begins = jnp.concatenate([self.t0[None], ends[:-1]])

        def to_next_sample(state, interval):
            state = where_reset(scene, state, t0=interval[0], t1=interval[1], steps=self.steps).final
            return state, state

        _, states = lax.scan(to_next_sample, self.start.state(scene), (begins, ends))
        return NaiveSamples(*_arrays(states), Status.successful, _no_events())


def _arrays(states: State):
    return states.q, states.v


def _no_events() -> NaiveEvents:
    none = jnp.full(1, -1)
    return NaiveEvents(none, none, jnp.full(1, jnp.inf))


def like(kind: type[Problem], problem: Problem, **settings) -> Problem:
    """The same problem, of another kind."""
    return kind(**vars(problem), **settings)
