"""The loop: iterate, watch, remember. It runs in Python, so that it can be watched, interrupted and resumed."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .growing import Growing
from .iterate import Pace
from .optimizers import Method
from .outcome import Outcome
from .watch import INTERRUPTED, STOPPED, Audience, Iteration, Sequence, Watch


class Room(NamedTuple):
    """When a run ends that does not converge."""

    iterations: int
    """Of the whole problem; stages have room of their own."""
    patience: int
    """Iterations in a row that do not improve the best loss by a millionth."""


class Descent(NamedTuple):
    """Where a run of an optimizer ended."""

    z: Float[Array, "unknown"]
    """The best point."""
    loss: float
    history: list[Iteration]
    start: Sequence
    end: Sequence
    """Event sequences at the first and at the best point."""
    stopped: str
    """Why it ended: "converged", "stalled", "no improvement", "max_iterations", or by hand."""
    whole: bool
    """False if it was ended by hand in a stage, before the whole problem had begun."""

    @property
    def by_hand(self) -> bool:
        """Whether somebody ended it."""
        return self.stopped in (INTERRUPTED, STOPPED)


def descend(
    method: Method | Growing, problem, z, room: Room, audience: Audience = Audience(), stages: bool = True  # noqa: B008
) -> Descent:
    """Iterate until the optimizer converges or stalls, or something else ends it; the best point is kept throughout.

    Without `stages` the whole problem comes at once.
    Raises: GuessFailed if the first point cannot be evaluated.
    """
    pace, watch, stopped = audience.pace or Pace(1), Watch(z, audience), ""
    done = pace.run(method, problem, method.begin(z, stages=stages), room.iterations + 1)
    try:
        while not stopped:
            for outcome in done.outcomes:
                stopped = stopped or watch.see(outcome) or _ended(outcome, watch, room)
            if not stopped:
                done = pace.run(method, problem, done.carry, room.iterations + (-watch.number if watch.whole else 1))
    except KeyboardInterrupt:
        stopped = INTERRUPTED
    z = jnp.asarray(watch.z)  # once: to the host and back takes longer than some iterations
    return Descent(z, watch.loss, watch.history, watch.first, watch.best, stopped, watch.whole)


def _ended(outcome: Outcome, watch: Watch, room: Room) -> str:
    if bool(outcome.in_stage):
        return ""
    if bool(outcome.converged):
        return "converged"
    if bool(outcome.stalled):
        return "stalled"
    if watch.idle >= room.patience:
        return "no improvement"
    return "max_iterations" if watch.number >= room.iterations else ""
