"""The loop of a fit, and what it remembers and tells: its iterations, its best point, its event sequences.

It runs in Python, so that it can be watched, interrupted and resumed."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .growing import Growing
from .iterate import BatchSize
from .motions import KINDS, EventRows
from .optimizers import Method
from .problem import Outcome, Trial
from .store import Store

EventSequence = tuple[tuple[str, int], ...]
"""An event sequence: (kind, contact) of every event in the order of time."""

WHOLE = "full"
"""The name of the whole problem, where stages of it have names too."""
STOPPED = "stopped by the callback"
INTERRUPTED = "interrupted"


class GuessFailed(ValueError):
    """The motion of the guess does not reach its end, so there is nothing to start from."""


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


class Callbacks(NamedTuple):
    """What is called after every iteration."""

    callback: Callable[[Iteration], Any] | None = None
    """Stops the run by returning True."""
    store: Store | None = None
    """Keeps the best point on disk."""
    batch_size: BatchSize | None = None
    """How many iterations pass between two looks; by default one."""
    known: float = float("inf")
    """The loss, on the whole record, of a point that the store holds already; inf: of none."""


def event_sequence(trial: Trial | EventRows) -> EventSequence:
    """Kinds and contacts of events."""
    happened = np.asarray(trial.kind) >= 0
    kinds, contacts = np.asarray(trial.kind)[happened].tolist(), np.asarray(trial.contact)[happened].tolist()
    return tuple((KINDS[k], c) for k, c in zip(kinds, contacts, strict=True))


def failure(trial: Trial) -> str:
    """Why a trial point could not be evaluated."""
    return trial.status.message or "a residual or its derivative is not finite."


class History:
    """Remembers the history of one run, and the best point of its present stage."""

    def __init__(self, z, callbacks: Callbacks, horizon: str):
        self.callbacks, self.horizon = callbacks, horizon
        self.z, self.loss, self.lines = z, float("inf"), []
        self.stage, self.number, self.idle = "", 0, 0
        self.best = self.last = ()

    @property
    def whole(self) -> bool:
        """Whether the whole problem has begun, and not stages of it alone."""
        return self.stage == WHOLE

    def see(self, outcome: Outcome) -> str:
        """Record an iteration; returns why to stop, or nothing."""
        if bool(outcome.first):
            return self._begin(outcome)
        accepted, loss = bool(outcome.accepted), float(outcome.loss)
        sequence = event_sequence(outcome.trial)
        changed = accepted and sequence != self.last
        self.number += 1
        self.idle = 0 if accepted and loss < self.loss * (1 - 1e-6) else self.idle + 1
        if accepted:
            self.last = sequence
        if accepted and loss <= self.loss:
            self.z, self.loss, self.best = outcome.z, loss, sequence
            self._keep()
        return self._tell(outcome, sequence, changed)

    def _begin(self, outcome: Outcome) -> str:
        """The first evaluation of a stage, which is left out if its motion fails, or of the whole problem."""
        in_stage = bool(outcome.in_stage)
        if bool(outcome.trial.failed):
            if in_stage:
                return ""
            raise GuessFailed(self._no_motion(failure(outcome.trial)))
        self.stage = f"horizon {float(outcome.trial.end):.3g}" if in_stage else WHOLE
        self.z, self.loss, self.number, self.idle = outcome.z, float(outcome.loss), 0, 0
        self.best = self.last = event_sequence(outcome.trial)
        self._keep()  # of many starts the best may leave nothing to do
        return self._tell(outcome, self.last, changed=False)

    def _no_motion(self, why: str) -> str:
        if not self.lines:
            must = "The guess must have a motion that reaches its end and has derivatives"
            return f"{must}, but at it {why}{self.horizon}"
        return (
            f"The stages before the whole record must end at a motion that reaches its end, but after {self.stage} "
            f"{why} A `GrowingHorizon` with more `steps` or less `trust` grows more slowly."
        )

    def _keep(self) -> None:
        store, known = self.callbacks.store, self.callbacks.known
        if store is not None and (known == float("inf") or (self.whole and self.loss <= known)):
            store.write(self.z)

    def _tell(self, outcome: Outcome, sequence: EventSequence, changed: bool) -> str:
        why = failure(outcome.trial) if bool(outcome.trial.failed) else ""
        line = Iteration(
            self.stage, self.number, float(outcome.loss), float(outcome.gradient_norm),
            bool(outcome.first | outcome.accepted), why, len(sequence), changed,
        )  # fmt: skip
        self.lines.append(line)
        callback = self.callbacks.callback
        return STOPPED if callback is not None and callback(line) else ""


UNFINISHED = ("stalled", "no improvement", "max_iterations")
"""Ends of a run that is not known to be at a minimum."""


class Limits(NamedTuple):
    """When a run ends that does not converge."""

    iterations: int
    """Of the whole problem; stages have room of their own."""
    patience: int
    """Iterations in a row that do not improve the best loss by a millionth."""


class Run(NamedTuple):
    """Where a run of an optimizer ended."""

    z: Float[Array, "unknown"]
    """The best point."""
    loss: float
    history: list[Iteration]
    end: EventSequence
    """The event sequence at the best point."""
    stopped: str
    """Why it ended: "converged", "stalled", "no improvement", "max_iterations", or by hand."""
    whole: bool
    """False if it was ended by hand in a stage, before the whole problem had begun."""


def descend(
    method: Method | Growing, problem, z, limits: Limits, callbacks: Callbacks | None = None, stages: bool = True
) -> Run:
    """Iterate until the optimizer converges or stalls, or something else ends it; the best point is kept throughout.

    Without `stages` the whole problem comes at once.
    Raises: GuessFailed if the first point cannot be evaluated.
    """
    callbacks = callbacks or Callbacks()
    batch_size, history, stopped = callbacks.batch_size or BatchSize(1), History(z, callbacks, _horizon(problem)), ""
    done = batch_size.run(method, problem, method.begin(z, stages=stages), limits.iterations + 1)
    try:
        while not stopped:
            for outcome in done.outcomes:
                at_minimum = functools.partial(method.confirms, problem, outcome.z)
                stopped = stopped or history.see(outcome) or _ended(outcome, history, limits, at_minimum)
            if not stopped:
                left = limits.iterations + (-history.number if history.whole else 1)
                done = batch_size.run(method, problem, done.carry, left)
    except KeyboardInterrupt:
        stopped = INTERRUPTED
    z = jnp.asarray(history.z)  # once: to the host and back takes longer than some iterations
    return Run(z, history.loss, history.lines, history.best, stopped, history.whole)


def _horizon(problem) -> str:
    """Where motions begin and end beside the record: times in another unit, or from another moment, show there."""
    times, told = problem.data.times, lambda time: f"{float(time):.6g}"
    record = f", its record goes from t = {told(times[0])} to {told(times[-1])}" if times.size else ""
    return f" A motion begins at t = {told(problem.t0)} and ends at {told(problem.horizon)}{record}."


def _ended(outcome: Outcome, history: History, limits: Limits, at_minimum: Callable[[], bool]) -> str:
    if bool(outcome.in_stage):
        return ""
    if bool(outcome.converged) and at_minimum():
        return "converged"
    if bool(outcome.stalled):
        return "stalled"
    if history.idle >= limits.patience:
        return "no improvement"
    return "max_iterations" if history.number >= limits.iterations else ""
