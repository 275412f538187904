"""Events that act some time after what caused them: a queue of delays for the mode of a hybrid system."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int


class DelayQueue(eqx.Module):
    """Which places of a queue of delayed events are taken: a part of the mode.

    The times at which the events come are a part of the state, of shape (place,) and with flow 0, because they are
    differentiated: by the delay, and by the time of what caused them.

        def scheduled_times(self, x, mode):
            return mode.times(x["due"])

        def transition(self, event, t, x, mode):
            due, later = mode.put(x["due"], t + self.delay)       # where something happened that acts later
            now = mode.take(event - guards)                       # where a delay has ended

    A motion in which more events wait than there are places ends with `Status.queue_full`.
    """

    taken: Bool[Array, "*batch place"]
    """Places whose event is still to come."""
    full: Bool[Array, "*batch"]
    """Whether an event found no place."""

    @classmethod
    def empty(cls, places: int) -> "DelayQueue":
        """A queue in which nothing waits. Raises: ValueError unless `places` is a positive integer."""
        if not isinstance(places, int) or places < 1:
            raise ValueError(f"`places` must be an integer >= 1, but is {places!r}.")
        return cls(jnp.zeros(places, bool), jnp.array(False))

    def times(self, due: Float[Array, "place"]) -> Float[Array, "place"]:
        """When the waiting events come; inf at free places.

        Raises: ValueError unless there is a time for each place."""
        self._must_fit(due)
        return jnp.where(self.taken, due, jnp.inf)

    @property
    def next_place(self) -> Int[Array, ""]:
        """The place that the next event takes: where what it carries is kept, as which neuron sent a spike. A full
        queue has none, and this is 0."""
        return jnp.argmin(self.taken)

    def put(self, due: Float[Array, "place"], time) -> tuple[Float[Array, "place"], "DelayQueue"]:
        """The times and the queue with one more event, which comes at `time`; never, and without a place, at inf.
        Raises: ValueError unless there is a time for each place."""
        self._must_fit(due)
        place, comes = self.next_place, jnp.asarray(time) != jnp.inf
        queue = DelayQueue(self.taken.at[place].max(comes), self.full | (self.taken[place] & comes))
        # A number that stays the same has come. One put where another was taken at this instant must differ from it.
        before = lax.stop_gradient(due[place])
        step = jnp.maximum(jnp.nextafter(before, jnp.inf) - before, jnp.finfo(due.dtype).tiny)
        time = time + jnp.where(before == time, step, 0)
        return due.at[place].set(jnp.where(comes, time, due[place])), queue

    def _must_fit(self, due: Array) -> None:
        if jnp.shape(due) != self.taken.shape:
            raise ValueError(
                f"`due` must have a time for each place of its DelayQueue, shape {self.taken.shape}, but has shape "
                f"{jnp.shape(due)}."
            )

    def take(self, place: Int[Array, ""]) -> "DelayQueue":
        """The queue after the event at `place` has come."""
        return DelayQueue(self.taken & (jnp.arange(self.taken.shape[0]) != place), self.full)


def overflowed(mode: Any) -> Bool[Array, ""]:
    """Whether any queue in a mode was full when it was needed."""
    parts = jax.tree.leaves(mode, is_leaf=lambda part: isinstance(part, DelayQueue))
    return jnp.any(jnp.stack([jnp.array(False), *(part.full for part in parts if isinstance(part, DelayQueue))]))
