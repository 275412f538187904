"""The least-squares problem of multiple shooting: windows of the horizon, and the jumps between them."""

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
from .problem import Problem, Trial
from .window_starts import edges_away_from_kinks, longest_window, states


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
        whole = jnp.full_like(problem.horizon, jnp.inf)
        return r, Trial(failed, worst, jnp.ravel(kind)[order], jnp.ravel(contact)[order], whole)

    def begun(self, end) -> "ShootingProblem":
        """The same: it has no stages."""
        del end
        return self

    def _window(self, scene, adjoint, start, t0, t1, places, inside):
        problem, numerics, dof = self.problem, self.problem.numerics, start.shape[0] // 2
        ts = jnp.where(inside, problem.data.times[places], t1)
        trajectory = simulate(
            scene, State(_outside(scene, t0, start[:dof]), start[dof:]), t0=t0, t1=t1, ts=ts, solver=numerics.solver,
            rtol=numerics.rtol, atol=numerics.atol, max_events=numerics.max_events, max_steps=numerics.max_steps,
            adjoint=adjoint, throw=False,
        )  # fmt: skip
        seen = jax.vmap(problem.observe, in_axes=(None, 0, 0, 0))(scene, ts, trajectory.q, trajectory.v)
        r = problem.limited((seen - problem.data.values[places]) * problem.data.weights[places] * inside[:, None])
        end = jnp.concatenate([trajectory.final.q, trajectory.final.v])
        return r, end, trajectory.status, trajectory.events.kind, trajectory.events.contact

    def _split(self, y):
        count = len(self.problem.selection.labels)
        return y[:count], y[count:].reshape(self.edges.shape[0] - 2, -1)


def cut(problem: Problem, z, windows: int) -> tuple[ShootingProblem, Array]:
    """The problem in windows with about equally many samples, and its first unknowns.

    Raises: ValueError if there are fewer than two samples for each window.
    """
    times = np.asarray(problem.data.times)
    if times.size < 2 * windows:
        raise ValueError(
            f"Multiple shooting must have two samples for each of {windows} windows, but has {times.size}."
        )
    first = edges_away_from_kinks(problem, windows)
    pieces = np.split(np.arange(times.size), first)
    longest = longest_window(times.size, windows)  # the same for every record, or each would compile anew
    places = np.stack([np.pad(piece, (0, longest - piece.size), mode="edge") for piece in pieces])
    inside = np.arange(longest) < np.array([[piece.size] for piece in pieces])
    edges = np.array([float(problem.t0), *times[first], float(problem.horizon)])
    begin = states(problem, z)
    scale = np.maximum(np.abs(begin).max(axis=0), 1e-12)
    edges, places, inside, scale = (jnp.asarray(array) for array in (edges, places, inside, scale))
    shooting = ShootingProblem(problem, edges, places, inside, scale, jnp.ones(()))
    return shooting, jnp.concatenate([z, jnp.ravel(jnp.asarray(begin[first]))])


def _outside(scene, t, q):
    """q, moved out of contacts that it penetrates: noise must not stop a window from starting."""
    gap = scene.gap(t, q)
    if gap.size == 0:
        return q
    jacobian = jax.jacfwd(lambda q: scene.gap(t, q))(q)
    return q + jnp.linalg.pinv(jacobian) @ jnp.maximum(-gap, 0)
