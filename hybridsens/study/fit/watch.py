"""What a run of an optimizer remembers and tells: its history, its best point, its event sequences."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...mechanics.mode import EventKind
from ...status import Status
from ...trajectory import Events
from .checkpoint import Checkpoint
from .iterate import Pace
from .outcome import Outcome
from .problem import Trial

Sequence = tuple[tuple[str, int], ...]
"""An event sequence: (kind, contact) of every event in the order of time."""

STOPPED = "stopped by the callback"


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


class Audience(NamedTuple):
    """Who hears of every iteration."""

    callback: Callable[[Iteration], Any] | None = None
    """Stops the run by returning True."""
    checkpoint: Checkpoint | None = None
    """Keeps the best point on disk."""
    pace: Pace | None = None
    """How many iterations pass between two looks; by default one."""


def event_sequence(trial: Trial | Events) -> Sequence:
    """Kinds and contacts of events."""
    happened = np.asarray(trial.kind) >= 0
    kinds, contacts = np.asarray(trial.kind)[happened].tolist(), np.asarray(trial.contact)[happened].tolist()
    return tuple((EventKind(k).name.lower(), c) for k, c in zip(kinds, contacts, strict=True))


def failure(trial: Trial) -> str:
    """Why a trial point could not be evaluated."""
    return Status[jax.tree.map(jnp.asarray, trial.status)] or "a residual or its derivative is not finite."


class Watch:
    """Remembers the history and the best point of one run."""

    def __init__(self, outcome: Outcome, stage: str, audience: Audience):
        self.stage, self.audience = stage, audience
        self.z, self.loss = jnp.asarray(outcome.z), float(outcome.loss)
        self.first = self.best = self.last = event_sequence(outcome.trial)
        self.idle = self.accepted = 0
        line = Iteration(stage, 0, self.loss, float(outcome.gradient_norm), True, "", len(self.first), False)
        self.history = [line]
        self._tell(line)

    def see(self, number: int, outcome: Outcome) -> str:
        """Record an iteration; returns why to stop, or nothing."""
        accepted, loss = bool(outcome.accepted), float(outcome.loss)
        sequence = event_sequence(outcome.trial)
        changed = accepted and sequence != self.last
        why = failure(outcome.trial) if bool(outcome.trial.failed) else ""
        line = Iteration(self.stage, number, loss, float(outcome.gradient_norm), accepted, why, len(sequence), changed)
        self.history.append(line)
        self.idle = 0 if accepted and loss < self.loss * (1 - 1e-6) else self.idle + 1
        if accepted:
            self.last, self.accepted = sequence, self.accepted + 1
        if accepted and loss <= self.loss:
            self.z, self.loss, self.best = jnp.asarray(outcome.z), loss, sequence
            self._keep()
        return self._tell(line)

    def _keep(self) -> None:
        if self.audience.checkpoint is not None:
            self.audience.checkpoint.write(self.z)

    def _tell(self, line: Iteration) -> str:
        callback = self.audience.callback
        return STOPPED if callback is not None and callback(line) else ""
