"""What `solve` returns. Everything with a floating point type here can be differentiated."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from .export.batches import leading, must_be_one, part_of
from .export.datasets import with_structure, write_netcdf
from .export.solution import solution_dataset, solution_events, solution_samples
from .export.text import preformatted, rows_shown
from .export.trees import as_text
from .numerics.event_times import first_times, sequence_number
from .numerics.sample_times import at_times
from .outcome import Steps, end_told, last_time
from .status import Status


class SolutionEvents(eqx.Module):
    """The events in the order of time, padded to `max_events`. Rows beyond `count` have time inf, guard -1 and zeros
    elsewhere. Axes are (event,), of a batch (*batch, event); the one event that `until` is given has none."""

    time: Float[Array, "*event"]
    """When."""
    guard: Int[Array, "*event"]
    """Which guard fell."""
    before: Any
    """States just before, with a leading axis (event,)."""
    after: Any
    """States just after."""
    mode: Any
    """Modes just after."""
    count: Int[Array, "*batch"]
    """How many events there were."""
    names: tuple[str, ...] | None = eqx.field(static=True, default=None)
    """The name of each number in `guard`, where the system has `event_names` or its comparisons are events."""

    @property
    def sequence(self) -> Int[Array, "*batch"]:
        """A number that two motions share if the same guards fell in the same order (else only by a rare accident).
        Where it changes between two steps of an optimiser, J may have a kink or a jump."""
        return sequence_number(self.guard, self.count)

    def name(self, number: int) -> str:
        """What an event of this number is called; "" for the -1 of a row beyond `count`."""
        if number < 0:
            return ""
        return str(number) if self.names is None else self.names[number]

    def to_pandas(self):
        """A pandas DataFrame with a row for each event that there was: time, guard, its name where it has one, mode
        after it (of a `DelayQueue` how many events wait), states before and after; of a batch, for each event of each
        run. Raises: ImportError without pandas; ValueError for a batch of more than one axis."""
        return solution_events(self)

    def times_of(self, guard: int | str, count: int) -> Float[Array, "*batch first"]:
        """Times of the first `count` events of one guard, by its number or its name, for a cost. Where there are fewer,
        inf: a cost that is finite all the same must tell what that is worth, `jnp.where(jnp.isfinite(t), t, t1)`.
        Raises: ValueError for a name that no event has, and for a `count` that is no integer from 1 to `max_events`."""
        if isinstance(guard, str):
            names = self.names or ()
            if guard not in names:
                known = ", ".join(names) or "the system has no `event_names`"
                raise ValueError(f"`guard` must be a number or one of the names ({known}), but is {guard!r}.")
            guard = names.index(guard)
        return first_times(self.time, self.guard == guard, count)


def blank_event(t, x: Any, mode: Any) -> SolutionEvents:
    """One event of a system, which says nothing but of which shapes and types events are."""
    number = jnp.array(0)
    return SolutionEvents(t, number, x, x, mode, number)


class Solution(eqx.Module):
    """A motion of a hybrid system from t0 to t1."""

    ts: Float[Array, "*batch sample"] | None
    """Times asked for."""
    x: Any
    """States there, of x's structure with a leading axis (sample,); just after the event where a time is an event's."""
    final: Any
    """State at t1, just after the event that it ended with (`until`), or where it broke off (see `status`)."""
    cost: Any
    """Integral of the running cost, with its structure; None without one."""
    events: SolutionEvents
    """In the order of time."""
    mode: Any
    """Mode at the end."""
    status: Status
    """`Status.successful`, or what went wrong."""
    end_time: Float[Array, "*batch"]
    """When it ended: at t1, with an event (`until`), or where it broke off, which derivatives hold fixed."""
    doubt_time: Float[Array, "*batch"]
    """When that happened, with status `grazing`, `guard_jumps` or `flow_jumps`, which puts its derivatives in doubt;
    nan for others."""
    steps: Steps
    """How much work it took."""
    waiting: Bool[Array, "*batch guard"]
    """Guards that could not fall at the end: below 0, they wait until they rise."""
    again: Any = eqx.field(repr=False)
    """The same solve for other `ts`; `evaluate` asks it."""

    def __getitem__(self, index: Any) -> "Solution":
        """The motions of a batch at `index`: `batch[3]`, `batch[:10]`, `batch[batch.status == Status.successful]`.

        Raises: IndexError outside of the batch; TypeError for one motion."""
        return part_of(self, index)

    def evaluate(self, ts: ArrayLike | Sequence) -> Any:
        """States at times between t0 and its end, a number or an array in any order, as exact as the motion itself.

        The motion is solved again, with samples at these times: a number of calls in a row is dearer than one call
        with all times, or `ts=` of `solve`. The number of times is rounded up inside, so that few numbers of them
        compile anew.

        Raises: ValueError for a motion that was loaded, which does not know its system, for a batch, and for times that
        are no numbers or lie outside of that."""
        if self.again is None:
            raise ValueError(
                "evaluate() must know the system of its motion, which is not in a file: pass `ts=` to `solve` before "
                "the motion is saved."
            )
        if np.ndim(self.events.count) > 0:
            must_be_one(self.events.count, "evaluate()")
        t0, t1 = self.again.horizon()
        return at_times(ts, t1.dtype, (t0, last_time(self, t1)), lambda ts: self.again(ts).x)

    def modes_after(self, passed: Int[Array | np.ndarray, "row"]) -> Any:
        """The modes after so many events each (row). The solution must know its system."""
        modes = lambda first, later: np.concatenate([np.asarray(first)[None], np.asarray(later)])[passed]
        return jax.tree.map(modes, self.again.initial_mode(), self.events.mode)

    def to_xarray(self):
        """An xarray Dataset of all that is here, named by the leaves of the state and of the mode (x.v, event_after.v,
        event_mode.on), with events in as many rows as there were. A batch has the dimension `run` in front of all
        others, and rows for the most events of a motion.

        Raises: ImportError without xarray; ValueError for a batch of more than one axis or inside of a JAX
        transformation."""
        return solution_dataset(self)

    def to_pandas(self):
        """A pandas DataFrame of the samples, indexed by time, of a batch by run and time: the state, and the mode
        unless the solution was loaded. `.events.to_pandas()` is that of the events.

        Raises: ImportError without pandas; ValueError for a batch of more than one axis or a motion without samples."""
        return solution_samples(self)

    def save(self, path: str | Path) -> None:
        """Write all of the motion, or of the batch, to a netCDF file (.nc), from which `hybridsens.load` makes the same
        solution.

        Raises: ImportError without xarray and netCDF4; ValueError for a batch of more than one axis or another ending;
        TypeError for a state, a mode or a cost that is made of more than dict, list, tuple and arrays."""
        leading(self.events.count, "save()")
        outlined = with_structure(self.to_xarray(), x=self.final, mode=self.mode, cost=self.cost)
        write_netcdf(outlined, path)

    _repr_html_ = preformatted  # what a notebook shows

    def __str__(self) -> str:
        if isinstance(self.events.count, jax.core.Tracer):
            return "Solution(traced)"
        if np.ndim(self.events.count) > 0:
            return f"Solution(batch of {np.shape(self.events.count)}; one: batch[i])"
        return "\n".join([*self._head(), *_table(self.events), f"final: {as_text(self.final)}"])

    def _head(self):
        yield f"status: {self.status}{end_told(self)}"
        accepted, rejected = int(self.steps.accepted), int(self.steps.rejected)
        yield f"steps: {accepted} accepted, {rejected} rejected; events: {int(self.events.count)}"
        if self.cost is not None:
            yield f"cost: {as_text(self.cost)}"
        for guard in self._below_from_the_start():
            yield f"guard {self.events.name(guard)} has been below 0 from the start: it waits until it rises"
        for guard in self._only_rose():
            name = self.events.name(guard)
            yield f"guard {name} rose above 0, and an event is where a guard falls: is its sign right?"

    def _below_from_the_start(self) -> list[int]:
        """Guards that wait and have had no event, so that none can have taken them below 0."""
        if int(self.events.count) == self.events.guard.shape[0]:
            return []
        fell = np.asarray(self.events.guard)
        return [guard for guard in np.flatnonzero(self.waiting).tolist() if guard not in fell]

    def _only_rose(self) -> list[int]:
        """Guards that began below 0, do not wait and have had no event, where nothing else happened."""
        if self.again is None or int(self.events.count) > 0:
            return []
        began = np.asarray(self.again.initial_guards())
        return [guard for guard in np.flatnonzero(began < 0).tolist() if not self.waiting[guard]]


def last_events(solution: Solution, shown: int = 3) -> str:
    """The last events of one motion with their modes, as an end to an error message; "" where they cannot be seen."""
    events = solution.events
    if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(events)):  # some of them in forward mode
        return ""
    if np.ndim(events.count) > 0 or int(events.count) == 0:
        return ""
    rows = range(max(0, int(events.count) - shown), int(events.count))
    mode = lambda j: "" if events.mode is None else f" to mode {as_text(_row(events.mode, j))}"
    kind = "event " if events.names is None else ""
    name = lambda j: f"{kind}{events.name(int(events.guard[j]))}"
    told = "; ".join(f"t = {float(events.time[j]):.9g}, {name(j)}{mode(j)}" for j in rows)
    return f" The last events: {told}."


def _row(tree, j: int):
    return jax.tree.map(lambda leaf: leaf[j], tree)


def _table(events: SolutionEvents):
    count = int(events.count)
    if count == 0:
        return
    names = [events.name(int(number)) for number in events.guard[:count]]
    wide = max(map(len, ["guard", *names]))
    yield f"{'event':>5} {'time':>14} {'guard':>{wide}}  mode after; state after"

    def row(j: int) -> str:
        mode = "" if events.mode is None else f"{as_text(_row(events.mode, j))}; "
        after = as_text(_row(events.after, j))
        return f"{j:>5} {float(events.time[j]):>14.9f} {names[j]:>{wide}}  {mode}{after}"

    yield from rows_shown(count, row)
