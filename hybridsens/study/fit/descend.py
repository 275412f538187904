"""The loop: iterate, watch, remember. It runs in Python, so that it can be watched, interrupted and resumed."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from ...forward.status import Status
from ...mechanics.mode import EventKind
from .optimizers import Method
from .outcome import Outcome
from .problem import Trial

Sequence = tuple[tuple[str, int], ...]
"""An event sequence: (kind, contact) of every event in the order of time."""

ENDED_BY_HAND = ("interrupted", "stopped by the callback")


class Iteration(NamedTuple):
    """One line of the history."""

    stage: str
    """Which problem: the full one, or a stage of a horizon strategy."""
    number: int
    loss: float
    gradient_norm: float
    accepted: bool
    failure: str
    """Why the trial point could not be evaluated; empty where it could."""
    events: int
    """Number of events at the trial point."""
    sequence_changed: bool
    """The trial point was taken, and its event sequence is another one than before."""


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
    """Why it ended: "converged", "stalled", "no improvement", "max_iterations", or one of `ENDED_BY_HAND`."""


class GuessFailed(ValueError):
    """The motion of the guess does not reach its end, so there is nothing to start from."""


def event_sequence(trial: Trial) -> Sequence:
    """Kinds and contacts of a trial's events."""
    kinds, contacts = np.asarray(trial.kind), np.asarray(trial.contact)
    return tuple((EventKind(int(k)).name.lower(), int(c)) for k, c in zip(kinds, contacts, strict=True) if k >= 0)


def descend(
    method: Method,
    problem,
    z,
    *,
    max_iterations: int,
    patience: int,
    stage: str = "full",
    callback: Callable[[Iteration], Any] | None = None,
    carry: Any = None,
) -> Descent:
    """Iterate until the optimizer converges or stalls, or something else ends it; the best point is kept throughout.

    `patience`: end after so many iterations without an improvement of the best loss by a millionth.
    Raises: GuessFailed if the first point cannot be evaluated.
    """
    first, outcome = method.start(problem, z)
    if bool(outcome.trial.failed):
        raise GuessFailed(f"The guess must have a motion that reaches its end, but at it {_failure(outcome.trial)}")
    carry = first if carry is None else carry
    watch = _Watch(outcome, stage, callback)
    stopped = "max_iterations"
    try:
        for number in range(1, max_iterations + 1):
            carry, outcome = method.step(problem, carry)
            stopped = watch.see(number, outcome) or _ended(outcome, watch.idle >= patience)
            if stopped:
                break
        else:
            stopped = "max_iterations"
    except KeyboardInterrupt:
        stopped = ENDED_BY_HAND[0]
    return Descent(watch.z, watch.loss, carry, watch.history, watch.first, watch.best, stopped)


class _Watch:
    """Remembers the history and the best point."""

    def __init__(self, outcome: Outcome, stage: str, callback: Callable[[Iteration], Any] | None):
        self.stage, self.callback = stage, callback
        self.z, self.loss = outcome.z, float(outcome.loss)
        self.first = self.best = self.last = event_sequence(outcome.trial)
        self.idle = 0
        line = Iteration(stage, 0, self.loss, float(outcome.gradient_norm), True, "", len(self.first), False)
        self.history = [line]
        self._tell(line)

    def see(self, number: int, outcome: Outcome) -> str:
        """Record an iteration; returns why to stop, or nothing."""
        accepted, loss = bool(outcome.accepted), float(outcome.loss)
        sequence = event_sequence(outcome.trial)
        changed = accepted and sequence != self.last
        failure = _failure(outcome.trial) if bool(outcome.trial.failed) else ""
        line = Iteration(
            self.stage, number, loss, float(outcome.gradient_norm), accepted, failure, len(sequence), changed
        )
        self.history.append(line)
        self.idle = 0 if accepted and loss < self.loss * (1 - 1e-6) else self.idle + 1
        if accepted:
            self.last = sequence
        if accepted and loss <= self.loss:
            self.z, self.loss, self.best = outcome.z, loss, sequence
        return self._tell(line)

    def _tell(self, line: Iteration) -> str:
        return ENDED_BY_HAND[1] if self.callback is not None and self.callback(line) else ""


def _ended(outcome: Outcome, idle: bool) -> str:
    if bool(outcome.converged):
        return "converged"
    if bool(outcome.stalled):
        return "stalled"
    return "no improvement" if idle else ""


def _failure(trial: Trial) -> str:
    return Status[trial.status] or "a residual or its derivative is not finite."
