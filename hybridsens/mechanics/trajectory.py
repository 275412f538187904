"""What a simulation returns. Everything with a floating point type here can be differentiated."""

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..export.batches import leading, must_be_known, part_of
from ..export.datasets import with_structure, write_netcdf
from ..export.text import paragraph, preformatted, table
from ..export.trajectory import motion_dataset, samples_frame
from ..export.trees import as_text
from ..numerics.sample_times import at_times
from ..outcome import Steps, end_told, last_time
from ..status import Status
from ..validation.asked import Asked
from .event_table import event_rows, event_table, state_text
from .events import Events
from .scene import State


class Origin(NamedTuple):
    """Where a motion came from."""

    scene: Any
    """The scene that moved, or the `Names` that a file has of it."""
    again: functools.partial | None
    """The same simulation for other `ts`; None for a motion from a file."""


class Trajectory(eqx.Module):
    """A motion of a scene from t0 to t1."""

    ts: Float[Array, "*batch sample"] | None
    """Times asked for."""
    q: Float[Array, "*batch sample dof"] | None
    """Configurations there; just after the event where a time is an event's."""
    v: Float[Array, "*batch sample dof"] | None
    """Velocities there."""
    final: State
    """State at t1, just after the event that it ended with (`until`), or where it broke off (see `status`)."""
    cost: Any
    """Integral of the running cost, with its structure; None without one."""
    events: Events
    """Impacts, captures, releases and switches, in the order of time."""
    mode: Bool[Array, "*batch contact"]
    """Contacts held closed at the end."""
    status: Status
    """`Status.successful`, or what went wrong."""
    end_time: Float[Array, "*batch"]
    """When it ended [s]: at t1, with an event (`until`), or where it broke off, which derivatives hold fixed."""
    doubt_time: Float[Array, "*batch"]
    """When that happened, with status `grazing`, `guard_jumps` or `flow_jumps`, which puts its derivatives in doubt
    [s]; nan for others."""
    steps: Steps
    """How much work it took."""
    scene_mode: Any = None
    """Mode of a scene with switches at the end; None for others."""

    def __getitem__(self, index: Any) -> "Trajectory":
        """The motions of a batch at `index`: `batch[3]`, `batch[:10]`, `batch[batch.status == Status.successful]`.

        Raises: IndexError outside of the batch; TypeError for one motion."""
        found = part_of(self, index)
        return found if self._scene is None else found.come_from(self._scene)

    def evaluate(self, ts: ArrayLike | Sequence) -> State:
        """States at times between t0 and its end, a number or an array in any order, as exact as the motion itself.

        The motion is simulated again with samples there, so one call with many times is cheaper than many calls. The
        number of times is rounded up inside, so that few numbers of them compile anew. What it returns is not
        differentiated: pass `ts=` to `simulate` for gradients.

        Raises: ValueError for a motion that was loaded, indexed out of a batch or made inside of `jax.jit`, which does
        not know its scene, and for times outside of that."""
        if any(isinstance(t, jax.core.Tracer) for t in jax.tree.leaves(ts)):
            raise ValueError(
                "evaluate() must be given known times: for derivatives by them, or inside of a transformation, pass "
                "`ts=` to `simulate`."
            )
        again = self._known_again("evaluate()")

        def sampled(ts):
            found = again(ts=ts)
            return State(found.q, found.v)

        horizon = again.keywords["t0"], last_time(self, again.keywords["t1"])
        return at_times(ts, self.final.q.dtype, horizon, sampled)

    def from_each_sample(self, cost: Callable[["Trajectory"], Array]) -> State:
        """d(cost) / d(state) for the motion that begins at each sample and ends where this one does: the costate.

        `cost` is a scalar function of a trajectory. A sample at the end, where nothing follows, is nan.
        Raises: ValueError as `evaluate`; TypeError for another kind of cost. The motion must have samples."""
        again = self._known_again("the costate")
        if again.keywords["until"] is not None:
            raise ValueError(
                "A costate must be that of a motion to t1, but this one has `until`: begun again at a sample, it would "
                "count its events anew and end with another one. Leave `until` out."
            )
        assert self.ts is not None and self.q is not None and self.v is not None
        t1 = again.keywords["t1"]

        asked = Asked("cost(trajectory)", cost)

        def value(state, t, mode):
            following = again.func(again.args[0], state, mode, **{**again.keywords, "t0": t, "throw": "nan"})
            try:
                J = asked(following)
            except TypeError as error:
                if "NoneType" not in str(error):
                    raise
                raise TypeError(
                    "`cost` must be made of what follows a sample, as the final state or a running cost, but reads "
                    f"samples, or a running cost that there is not: {error}."
                ) from error
            if J is None or jnp.shape(J) != ():
                returned = "None" if J is None else f"an array of shape {jnp.shape(J)}"
                raise TypeError(f"`cost` must return a number of each trajectory, but returns {returned}.")
            return J

        inside = np.asarray(self.ts) < t1
        before_end = jnp.where(inside, self.ts, self.ts[0])
        past = np.searchsorted(self.events.time[: int(self.events.count)], self.ts, side="right")
        mode = self.modes_after(past)
        one = lambda sample: jax.grad(value)(*sample)
        # One after the other: the program of a batch takes longer to compile than these take to run.
        found = jax.jit(lambda samples: lax.map(one, samples))((State(self.q, self.v), before_end, mode))
        return jax.tree.map(lambda leaf: jnp.where(inside[:, None], leaf, jnp.nan), found)

    def modes_after(self, passed: Int[Array | np.ndarray, "row"]) -> Any:
        """The modes of a scene with switches after so many events each (row); None for another scene.

        Raises: ValueError for a motion that does not know its scene, as `evaluate`."""
        modes = lambda first, later: jnp.concatenate([jnp.asarray(first)[None], later])[passed]
        return jax.tree.map(modes, self._known_again("the mode").args[2], self.events.mode)

    def to_xarray(self):
        """An xarray Dataset of all that is here, with events in as many rows as there were.

        Coordinates are named as the scene's `coordinates`, contacts as its `contacts`, if it has them. A batch has the
        dimension `run` in front of all others, rows for the most events of a motion, and names where it is told its
        scene: `batch.come_from(scene).to_xarray()`.
        Raises: ImportError without xarray; ValueError for a batch of more than one axis or inside of a JAX
        transformation."""
        return motion_dataset(self, self._scene)

    def to_pandas(self):
        """A pandas DataFrame of the samples, indexed by time, of a batch by run and time. `.events.to_pandas()` is
        that of the events.

        Raises: ImportError without pandas; ValueError for a batch of more than one axis or a motion without samples."""
        return samples_frame(self, self._scene)

    def save(self, path: str | Path) -> None:
        """Write all of the motion, or of the batch, to a netCDF file (.nc), from which `hybridsens.load` makes the same
        trajectory.

        Raises: ImportError without xarray and netCDF4; ValueError for a batch of more than one axis or another ending;
        TypeError for a cost or a mode that is made of more than dict, list, tuple and arrays."""
        leading(self.events.count, "save()")
        trees = dict(cost=self.cost, scene_mode=self.scene_mode, event_mode=self.events.mode)
        write_netcdf(with_structure(self.to_xarray(), **trees), path)

    def come_from(self, scene: Any, again: functools.partial | None = None) -> "Trajectory":
        """This motion, which now knows what it came from: its tables have the scene's names.

        That is no field: it would ride along as an output of every compiled program, and be copied for every motion of
        a batch. So what JAX makes out of this trajectory, a batch among it, does not know it."""
        object.__setattr__(self, "_origin", Origin(scene, again))
        object.__setattr__(self.events, "_scene", scene)
        return self

    @property
    def _scene(self) -> Any:
        origin = getattr(self, "_origin", None)
        return None if origin is None else origin.scene

    def _known_again(self, wanted_by: str) -> functools.partial:
        must_be_known(self.events.count, wanted_by)
        again = getattr(getattr(self, "_origin", None), "again", None)
        if again is None:
            raise ValueError(
                f"{wanted_by} must know the scene of its motion, which is lost where a motion is loaded, in a batch or "
                "returned by jax.jit, and of which `come_from` tells the names alone. Pass `ts=` to `simulate` instead."
            )
        return again

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        if isinstance(self.final.q, jax.core.Tracer) or np.ndim(self.events.count) > 0:
            return preformatted(self)
        header, *rows = event_rows(self.events)
        lines = [*self._head(), f"final: {state_text(self.final)}"]
        return "".join([*map(paragraph, lines), table(header, rows) if rows else ""])

    def __str__(self) -> str:
        if isinstance(self.final.q, jax.core.Tracer):
            return f"Trajectory(traced, final q of shape {self.final.q.shape})"
        if np.ndim(self.events.count) > 0:
            return f"Trajectory(batch of {np.shape(self.events.count)}; one: batch[i])"
        return "\n".join([*self._head(), *event_table(self.events), f"final: {state_text(self.final)}"])

    def _head(self):
        accepted, rejected = int(self.steps.accepted), int(self.steps.rejected)
        yield f"status: {self.status}{end_told(self)}"
        yield f"steps: {accepted} accepted, {rejected} rejected; events: {int(self.events.count)}"
        if self.cost is not None:
            yield f"cost: {as_text(self.cost)}"
        if self.scene_mode is not None:
            yield f"mode: {as_text(self.scene_mode)}"
