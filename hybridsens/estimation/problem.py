"""The least-squares problem: residuals of a motion against measurements, as a function of the unknowns z."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..adjoint.methods import AbstractGradientMethod, Replay
from ..mechanics.trajectory import Trajectory
from ..solution import Solution
from ..status import Status
from .horizon import Stage
from .motions import EventRows, FixedSettings, Start, event_rows, motion_of, samples, strikes
from .parameters import Selection


class Trial(NamedTuple):
    """What happened at a trial point."""

    failed: Bool[Array, ""]
    """The motion did not reach its end, or a residual is not finite."""
    status: Status
    kind: Int[Array, "event"]
    """The event sequence: an `EventKind` each, -1 in padding."""
    contact: Int[Array, "event"]
    """Which contact, -1 in padding."""
    end: Float[Array, ""]
    """Until when it was compared with the record, in a stage of `GrowingHorizon`; inf: all of it."""


class Outcome(NamedTuple):
    """One iteration of any optimizer."""

    z: Float[Array, "unknown"]
    """Where the optimizer stands after it."""
    loss: Float[Array, ""]
    """sum r^2 / 2 there."""
    gradient_norm: Float[Array, ""]
    """|dloss/dz| there."""
    accepted: Bool[Array, ""]
    """Whether the trial point was taken."""
    converged: Bool[Array, ""]
    stalled: Bool[Array, ""]
    """No trial point has been taken for several iterations."""
    first: Bool[Array, ""]
    """It is the first evaluation of a problem, so there was nothing to take a step from."""
    trial: Trial
    """What happened at the trial point."""

    @property
    def in_stage(self) -> Bool[Array, ""] | np.bool_:
        """Whether a shorter horizon than the problem's was fitted."""
        return self.trial.end < jnp.inf

    @property
    def ends(self) -> Bool[Array, ""] | np.bool_:
        """Whether the optimizer has nothing left to do: it is done or stuck, or has no motion to begin with."""
        return self.converged | self.stalled | (self.first & self.trial.failed)


class Observations(eqx.Module):
    """Measurements as a problem needs them: nothing is NaN, and what is missing has weight 0."""

    times: Float[Array, "sample"]
    values: Float[Array, "sample observation"]
    weights: Float[Array, "sample observation"]
    """1 / sigma, 0 where nothing was measured."""
    event_times: Float[Array, "event"]
    event_weights: Float[Array, "event"]
    """1 / sigma of the event times."""
    event_contacts: Int[Array, "event"]
    event_ranks: Int[Array, "event"]
    """The measured time is that of the impact with this number at its contact."""


class Prior(eqx.Module):
    """Normal priors of the parameters: (p - mean) / sigma are residuals too."""

    mean: Float[Array, "parameter"]
    weight: Float[Array, "parameter"]
    """1 / sigma, 0 without a prior."""


class FitProblem(eqx.Module):
    """Least squares: minimise sum r^2 / 2 over z; r holds observations, event times and priors, each in sigmas."""

    scene: Any
    selection: Selection
    start: Start
    observe: Callable[..., Any]
    """observe(scene, t, q, v), or observe(system, t, x) -> (observation,)"""
    data: Observations
    prior: Prior
    t0: Float[Array, ""]
    horizon: Float[Array, ""]
    """Motions end here."""
    sigma_unit: Float[Array, ""]
    """How large a residual of one sigma is: 1 where sigmas were given."""
    robust: Float[Array, ""]
    """Residuals beyond this (in sigmas) count linearly (pseudo-Huber); inf: all count squared."""
    settings: FixedSettings
    stage: Stage | None = None
    """None: the whole problem."""

    def scene_at(self, z: Float[Array, "parameter"]):
        """The scene with the parameters p(z)."""
        return self.selection.insert(self.scene, self.selection.to_values(z))

    def residuals(
        self, z: Float[Array, "parameter"], adjoint: AbstractGradientMethod
    ) -> tuple[Float[Array, "residual"], Trial]:
        """Residuals in sigmas, (sample x observation + event + parameter,), and what happened; in a stage, a row more
        for each parameter. What a motion does after the stage's end does not matter, not even whether it fails."""
        scene, stage = self.scene_at(z), self.stage
        trajectory = self.motion(scene, adjoint)
        seen, events = self.observed(scene, trajectory), event_rows(trajectory)
        end = jnp.full_like(self.horizon, jnp.inf) if stage is None else stage.chosen_end(self, seen)
        r = self.limited(jnp.concatenate([self._sample_residuals(seen, end), self._event_residuals(events, end)]))
        prior = (self.selection.to_values(z) - self.prior.mean) * self.prior.weight
        r = jnp.concatenate([r, prior, *([] if stage is None else [stage.anchor_residuals(self, z, end)])])
        stopped = (trajectory.status != Status.successful) & ~(end < self.motion_end)
        kind, contact = (jnp.where(events.time <= end, row, -1) for row in (events.kind, events.contact))
        return r, Trial(stopped | ~jnp.all(jnp.isfinite(r)), trajectory.status, kind, contact, end)

    def at_stage_end(self, end) -> "FitProblem":
        """The same problem; a stage is one that ends there, whatever a motion shows."""
        if self.stage is None:
            return self
        stage = dataclasses.replace(self.stage, end=end, begins=jnp.array(False))
        return dataclasses.replace(self, stage=stage)

    @property
    def motion_end(self) -> Float[Array, ""]:
        """How far motions go [s]."""
        return self.horizon if self.stage is None else self.stage.motion_end(self)

    def motion(self, scene, adjoint: AbstractGradientMethod) -> Trajectory | Solution:
        """The motion at the data's times."""
        end = self.motion_end
        ts = jnp.minimum(self.data.times, end)
        return motion_of(scene, self.start, (self.t0, end), ts, self.settings, adjoint)

    def observed(self, scene, motion: Trajectory | Solution) -> Float[Array, "sample observation"]:
        """What would be measured of a motion at the data's times."""
        if self.data.times.size == 0:
            return self.data.values
        states = samples(motion)
        observe = eqx.filter_vmap(self.observe, in_axes=(None, 0, *[0 for _ in states]))
        return observe(scene, self.data.times, *states)

    def _sample_residuals(self, seen, end):
        r = (seen - self.data.values) * self.data.weights
        return jnp.ravel(jnp.where((self.data.times <= end)[:, None], r, 0))

    def _event_residuals(self, events: EventRows, end):
        """Times of matching impacts; a motion with fewer impacts than were measured has the missing ones at the end."""
        data, match, last = self.data, self.matches(events), jnp.minimum(end, self.horizon)
        times = jnp.where(jnp.any(match, axis=1), events.time[jnp.argmax(match, axis=1)], last)
        times = jnp.minimum(times, last)
        return jnp.where(data.event_times <= end, (times - data.event_times) * data.event_weights, 0)

    def matches(self, events: EventRows) -> Bool[Array, "event happened"]:
        """Which event of a motion is the one measured."""
        data, wanted = self.data, self.data.event_contacts[:, None]
        here = strikes(events.kind) & ((events.contact == wanted) | (wanted < 0))
        return here & (jnp.cumsum(here, axis=1) - 1 == data.event_ranks[:, None])

    def limited(self, r):
        """Residuals whose squares are c^2 (2 sqrt(1 + (r/c)^2) - 2): large ones count linearly."""
        return r * jnp.sqrt(2 / (1 + jnp.sqrt(1 + (r / self.robust) ** 2)))


@eqx.filter_jit
def predict(
    problem: FitProblem, z: Float[Array, "parameter"]
) -> tuple[Trajectory | Solution, Float[Array, "sample observation"]]:
    """The motion at z, and what would be measured of it; compiled once for all who ask."""
    scene = problem.scene_at(z)
    trajectory = problem.motion(scene, Replay())
    return trajectory, problem.observed(scene, trajectory)
