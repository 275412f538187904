"""What the forward pass writes down, and all that the backward pass will read: nothing is derived from t later."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..hybrid import AbstractHybridSystem, Decision, Mode
from ..status import Status


class StepRecord(eqx.Module):
    """The accepted steps: step k goes from (t[k], x[k]) to t[k+1], where x[k] already includes a jump at t[k]."""

    t: Float[Array, "step"]
    """Grid times; inf beyond the last."""
    x: Float[Array, "step state"]
    """State at the start of each step; the last entry is the final state."""
    count: Int[Array, ""]
    """Number of accepted steps so far."""

    def append(self, t, x, keep) -> "StepRecord":
        """Write the end of a step; an entry that is not kept is overwritten by the next."""
        place = self.count + 1
        return StepRecord(write(self.t, t, place), write(self.x, x, place), self.count + keep)

    def jump(self, x) -> "StepRecord":
        """Replace the current state by the one after a jump."""
        return StepRecord(self.t, write(self.x, x, self.count), self.count)


class EventRecord(eqx.Module):
    """Event j ends segment j. Arrays hold `max_events` entries, of which `count` are used."""

    time: Float[Array, "event"]
    """When, inf beyond the last."""
    guard: Int[Array, "event"]
    """Which guard fell through zero; -1 beyond the last."""
    before: Float[Array, "event state"]
    """State just before, x-."""
    after: Float[Array, "event state"]
    """State just after, x+."""
    emitted: PyTree[Array]
    """What the reset emitted: impulses in mechanics."""
    decision: Decision
    """The discrete outcome, with the mode of segment j + 1."""
    mode: Mode
    """The mode of segment j."""
    steps: Int[Array, "event"]
    """Number of accepted steps up to the event."""
    first_step: Float[Array, "event"]
    """Size of the step that was tried next after the event."""
    count: Int[Array, ""]
    """How many events there were."""

    def append(self, passes, **entry) -> "EventRecord":
        """Write the next event; one that does not pass is overwritten by the next."""
        fields = {name: getattr(self, name) for name in entry}
        written = jax.tree.map(lambda buffer, leaf: write(buffer, leaf, self.count), fields, entry)
        return EventRecord(**written, count=self.count + passes)


class Motion(eqx.Module):
    """The forward pass as far as it has come.

    The two records are only ever written: where the motion stands is carried beside them, because a buffer that is
    read and written in the same loop is copied whole at every turn.
    """

    begun: Bool[Array, ""]
    """Whether the initial mode has been chosen."""
    t: Float[Array, ""]
    """Where the motion stands."""
    x: Float[Array, "state"]
    """The state there."""
    mode: Mode
    """The mode there."""
    steps: StepRecord
    events: EventRecord
    last_guard: Int[Array, ""]
    """Guard of the last event, -1 before the first."""
    last_event: Float[Array, ""]
    """Time of the last event."""
    grazing: Bool[Array, ""]
    """Whether any event so far was grazing."""
    rejected: Int[Array, ""]
    """Steps that were tried and not kept (those that overshot an event among them)."""
    first_step: Float[Array, ""]
    """Size of the step to try next; 0 where the error control has to find one."""
    status: Status


def write(buffer: Array, row: Array, place: Int[Array, ""]) -> Array:
    """Write one row of a buffer."""
    return lax.dynamic_update_index_in_dim(buffer, jnp.asarray(row, buffer.dtype), place, 0)


def empty_motion(
    system: AbstractHybridSystem, t0, x0, mode: Mode, max_events: int, max_steps: int, status
) -> Motion:
    """A motion that stands at (t0, x0) and has room for `max_steps` steps and `max_events` events.

    Both records have one row more than they may use, for the entry that is written and then not kept.
    """
    steps = empty_steps(t0, x0, max_steps)
    decision = jax.eval_shape(lambda: system.choose(jnp.array(0), t0, x0, mode))
    _, emitted = jax.eval_shape(lambda decision: system.reset(decision, t0, x0), decision)
    rows = lambda tree: jax.tree.map(lambda leaf: jnp.zeros((max_events + 1, *leaf.shape), leaf.dtype), tree)
    events = EventRecord(
        time=jnp.full(max_events + 1, jnp.inf, t0.dtype),
        guard=jnp.full(max_events + 1, -1),
        before=rows(x0),
        after=rows(x0),
        emitted=rows(emitted),
        decision=rows(decision),
        mode=rows(mode),
        steps=jnp.zeros(max_events + 1, int),
        first_step=jnp.zeros(max_events + 1, t0.dtype),
        count=jnp.array(0),
    )
    never = jnp.array(-jnp.inf, t0.dtype)
    no = jnp.array(False)
    return Motion(no, t0, x0, mode, steps, events, jnp.array(-1), never, no, jnp.array(0), jnp.zeros_like(t0), status)


def empty_steps(t, x, max_steps: int) -> StepRecord:
    """A record that starts at (t, x). What is written beyond its room is lost, and counted all the same."""
    t, x = lax.optimization_barrier((t, x))  # or XLA fills a long record while it compiles, where t is a constant
    times = jnp.full(max_steps + 2, jnp.inf, t.dtype).at[0].set(t)
    states = jnp.zeros((max_steps + 2, x.shape[0]), x.dtype).at[0].set(x)
    return StepRecord(times, states, jnp.array(0))


def segment(motion: Motion, j) -> tuple[Mode, Int[Array, ""], Int[Array, ""]]:
    """Mode, first step and one past the last step of segment j, which lies between events j - 1 and j."""
    events = motion.events
    here, previous = jnp.minimum(j, events.steps.shape[0] - 1), jnp.maximum(j - 1, 0)
    ended = j < events.count
    mode = jax.tree.map(lambda rows, final: jnp.where(ended, rows[here], final), events.mode, motion.mode)
    first = jnp.where(j > 0, events.steps[previous], 0)
    return mode, first, jnp.where(ended, events.steps[here], motion.steps.count)
