"""The loop: iterate, watch, remember. It runs in Python, so that it can be watched, interrupted and resumed."""

from typing import Any, NamedTuple

from jaxtyping import Array, Float

from .iterate import Pace
from .optimizers import FAR, Method
from .outcome import Outcome
from .watch import STOPPED, Audience, Iteration, Sequence, Watch, failure

INTERRUPTED = "interrupted"
ENDED_BY_HAND = (INTERRUPTED, STOPPED)


class Room(NamedTuple):
    """When a run ends that does not converge."""

    iterations: int
    patience: int
    """Iterations in a row that do not improve the best loss by a millionth."""
    accepted: float = float("inf")
    """Accepted steps."""


class Descent(NamedTuple):
    """Where a run of an optimizer ended."""

    z: Float[Array, "unknown"]
    """The best point."""
    loss: float
    carry: Any
    """The optimizer's state, to go on from."""
    history: list[Iteration]
    start: Sequence
    end: Sequence
    """Event sequences at the first and at the best point."""
    stopped: str
    """Why it ended: "converged", "stalled", "no improvement", "max_iterations", "stage done" (enough steps accepted),
    or one of `ENDED_BY_HAND`."""


class GuessFailed(ValueError):
    """The motion of the guess does not reach its end, so there is nothing to start from."""


def descend(
    method: Method, problem, z, room: Room, *, stage: str = "full", audience: Audience = Audience(),  # noqa: B008
    damping: float = FAR, carry: Any = None,
) -> Descent:  # fmt: skip
    """Iterate until the optimizer converges or stalls, or something else ends it; the best point is kept throughout.

    `carry` is the state of an earlier run to go on from.
    Raises: GuessFailed if the first point cannot be evaluated.
    """
    pace = audience.pace or Pace(1)
    first = room.iterations + 1 if carry is None else 1
    done = pace.run(method, problem, method.begin(z, damping), first, room.accepted)
    watch = _watch(done.outcomes.pop(0), stage, audience)
    carry, number, stopped = done.carry if carry is None else carry, 0, ""
    try:
        while not stopped:
            for outcome in done.outcomes:
                number += 1
                stopped = watch.see(number, outcome) or _ended(outcome, watch, room)
            if not stopped and number >= room.iterations:
                stopped = "max_iterations"
            if not stopped:
                done = pace.run(method, problem, carry, room.iterations - number, room.accepted - watch.accepted)
                carry = done.carry
    except KeyboardInterrupt:
        stopped = INTERRUPTED
    return Descent(watch.z, watch.loss, carry, watch.history, watch.first, watch.best, stopped)


def _watch(outcome: Outcome, stage: str, audience: Audience) -> Watch:
    if bool(outcome.trial.failed):
        raise GuessFailed(f"The guess must have a motion that reaches its end, but at it {failure(outcome.trial)}")
    return Watch(outcome, stage, audience)


def _ended(outcome: Outcome, watch: Watch, room: Room) -> str:
    if bool(outcome.converged):
        return "converged"
    if bool(outcome.stalled):
        return "stalled"
    if watch.accepted >= room.accepted:
        return "stage done"
    return "no improvement" if watch.idle >= room.patience else ""
