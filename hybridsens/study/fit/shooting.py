"""Multiple shooting: the horizon is cut into windows, each with a free initial state, and penalties tie them
together."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ...adjoint.methods import AbstractGradientMethod
from ...mechanics.scene import State
from ...simulate import simulate
from ...status import Status
from .descend import ENDED_BY_HAND, Descent, Room, descend
from .optimizers import Method
from .prepare import StateObserver
from .problem import Problem, Trial
from .watch import Audience


class MultipleShooting(eqx.Module):
    """Fit windows of the horizon side by side, tied together more firmly from stage to stage; then the full problem.

    Meant for motions that forget their start (chaos, many impacts). It works best when all coordinates are measured:
    then the windows start from the data; otherwise from the motion of the guess. Event times take no part in it.
    Where the motion is not chaotic try `GrowingHorizon` first: from guesses up to 30 % off it found the elastic stop's
    six parameters in 99 of 100 records, multiple shooting in 9 of 20 (benchmarks/fit_recovery.py).
    """

    windows: int = eqx.field(static=True, default=4)
    continuity: tuple[float, ...] = eqx.field(static=True, default=(0.1, 1.0, 10.0))
    """Weight of a jump between windows in each stage, in residuals per percent of the coordinate's size."""
    iterations: int = eqx.field(static=True, default=15)
    """At most so many in each stage."""

    def __check_init__(self):
        if self.windows < 2 or not self.continuity or min(self.continuity) <= 0:
            raise ValueError(
                "`windows` must be >= 2 and `continuity` must have positive weights, but they are "
                f"{self.windows} and {self.continuity}."
            )

    def run(self, how: Method, problem: Problem, z, audience: Audience) -> tuple[list[Descent], Array]:
        """All stages, and the parameters to go on with."""
        shooting, y = cut(problem, z, self.windows)
        done = []
        for weight in self.continuity:
            stage = eqx.tree_at(lambda s: s.weight, shooting, jnp.asarray(100 * weight, y.dtype) * problem.sigma_unit)
            done.append(descend(how, stage, y, Room(self.iterations, self.iterations), stage=f"continuity {weight:g}",
                                audience=audience))  # fmt: skip
            y = done[-1].z
            if done[-1].stopped in ENDED_BY_HAND:
                break
        return done, y[: z.size]


class ShootingProblem(eqx.Module):
    """Residuals of all windows and of the jumps between them, as a function of y = (z, initial states of windows 1,
    ...)."""

    problem: Problem
    edges: Float[Array, "edge"]
    """Times at which windows begin and end."""
    places: Int[Array, "window sample"]
    """Which samples lie in a window; padded."""
    inside: Bool[Array, "window sample"]
    """False in padding."""
    scale: Float[Array, "state"]
    """Sizes of coordinates and velocities."""
    weight: Float[Array, ""]
    """Residual of a jump as large as the coordinate."""

    def residuals(self, y, adjoint: AbstractGradientMethod) -> tuple[Float[Array, "residual"], Trial]:
        """Residuals of samples, jumps and priors, and what happened in the windows."""
        problem, z, starts = self.problem, *self._split(y)
        scene = problem.scene_at(z)
        first = problem.initial_state(scene)
        starts = jnp.concatenate([jnp.concatenate([first.q, first.v])[None], starts])
        windows = (starts, self.edges[:-1], self.edges[1:], self.places, self.inside)
        seen, ends, status, kind, contact = lax.map(lambda window: self._window(scene, adjoint, *window), windows)
        jumps = (ends[:-1] - starts[1:]) / self.scale * self.weight
        p = problem.selection.to_values(z)
        r = jnp.concatenate([jnp.ravel(seen), jnp.ravel(jumps), (p - problem.prior.mean) * problem.prior.weight])
        failures = jax.vmap(lambda s: s != Status.successful)(status)
        worst = jax.tree.map(lambda leaf: leaf[jnp.argmax(failures)], status)
        order = jnp.argsort(jnp.ravel(kind) < 0, stable=True)
        failed = jnp.any(failures) | ~jnp.all(jnp.isfinite(r))
        return r, Trial(failed, worst, jnp.ravel(kind)[order], jnp.ravel(contact)[order])

    def _window(self, scene, adjoint, start, t0, t1, places, inside):
        problem, numerics, dof = self.problem, self.problem.numerics, start.shape[0] // 2
        ts = jnp.where(inside, problem.data.times[places], t1)
        trajectory = simulate(
            scene, State(_outside(scene, t0, start[:dof]), start[dof:]), t0=t0, t1=t1, ts=ts, solver=numerics.solver,
            rtol=numerics.rtol, atol=numerics.atol, max_events=numerics.max_events, max_steps=numerics.max_steps,
            adjoint=adjoint, throw=False,
        )  # fmt: skip
        seen = jax.vmap(problem.observe, in_axes=(None, 0, 0, 0))(scene, ts, trajectory.q, trajectory.v)
        r = (seen - problem.data.values[places]) * problem.data.weights[places] * inside[:, None]
        end = jnp.concatenate([trajectory.final.q, trajectory.final.v])
        return r, end, trajectory.status, trajectory.events.kind, trajectory.events.contact

    def _split(self, y):
        count = len(self.problem.selection.labels)
        return y[:count], y[count:].reshape(self.edges.shape[0] - 2, -1)


def cut(problem: Problem, z, windows: int) -> tuple[ShootingProblem, Array]:
    """The problem in windows with equally many samples, and its first unknowns.

    Raises: ValueError if there are fewer than two samples for each window.
    """
    times = np.asarray(problem.data.times)
    if times.size < 2 * windows:
        raise ValueError(
            f"Multiple shooting must have two samples for each of {windows} windows, but has {times.size}."
        )
    pieces = np.array_split(np.arange(times.size), windows)
    longest = max(piece.size for piece in pieces)
    places = np.stack([np.pad(piece, (0, longest - piece.size), mode="edge") for piece in pieces])
    inside = np.arange(longest) < np.array([[piece.size] for piece in pieces])
    edges = np.array([float(problem.t0), *(times[piece[0]] for piece in pieces[1:]), float(problem.horizon)])
    states = _states(problem, z, times)
    scale = np.maximum(np.abs(states).max(axis=0), 1e-12)
    starts = np.stack([states[piece[0]] for piece in pieces[1:]])
    edges, places, inside, scale = (jnp.asarray(array) for array in (edges, places, inside, scale))
    shooting = ShootingProblem(problem, edges, places, inside, scale, jnp.ones(()))
    return shooting, jnp.concatenate([z, jnp.ravel(jnp.asarray(starts))])


def _states(problem: Problem, z, times: np.ndarray) -> np.ndarray:
    """(sample, state): measured where the coordinates were, with slopes as velocities; the guess's motion elsewhere."""
    scene, numerics = problem.scene_at(z), problem.numerics
    trajectory = simulate(
        scene, problem.initial_state(scene), t0=problem.t0, t1=problem.horizon, ts=problem.data.times,
        solver=numerics.solver,
        rtol=numerics.rtol, atol=numerics.atol, max_events=numerics.max_events, max_steps=numerics.max_steps,
        throw=False,
    )  # fmt: skip
    assert trajectory.q is not None and trajectory.v is not None
    states = np.concatenate([trajectory.q, trajectory.v], axis=1)
    dof = states.shape[1] // 2
    if isinstance(problem.observe, StateObserver):
        for column, pick in enumerate(problem.observe.picks):
            known = np.asarray(problem.data.weights)[:, column] > 0
            measured = np.asarray(problem.data.values)[known, column]
            position, slope = _smooth(times, times[known], measured)
            states[:, pick] = position
            if pick < dof and pick + dof not in problem.observe.picks:
                states[:, pick + dof] = slope
    return states


def _smooth(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes at these times, of a parabola through the seven measurements nearest to each."""
    near = np.argsort(np.abs(times - at[:, None]), axis=1)[:, : min(7, times.size)]
    fits = [np.polynomial.polynomial.polyfit(times[n] - t, values[n], min(2, n.size - 1)) for t, n in zip(at, near)]
    return np.array([c[0] for c in fits]), np.array([c[1] if c.size > 1 else 0.0 for c in fits])


def _outside(scene, t, q):
    """q, moved out of contacts that it penetrates: noise must not stop a window from starting."""
    gap = scene.gap(t, q)
    if gap.size == 0:
        return q
    jacobian = jax.jacfwd(lambda q: scene.gap(t, q))(q)
    return q + jnp.linalg.pinv(jacobian) @ jnp.maximum(-gap, 0)
