"""The loop of a fit. It runs in Python, so that it can be watched, interrupted and resumed."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .growing import Growing
from .history import INTERRUPTED, STOPPED, Callbacks, History, Iteration, Sequence
from .iterate import BatchSize
from .optimizers import Method
from .outcome import Outcome

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
    start: Sequence
    end: Sequence
    """Event sequences at the first and at the best point."""
    stopped: str
    """Why it ended: "converged", "stalled", "no improvement", "max_iterations", or by hand."""
    whole: bool
    """False if it was ended by hand in a stage, before the whole problem had begun."""

    @property
    def interrupted(self) -> bool:
        """Whether somebody ended it."""
        return self.stopped in (INTERRUPTED, STOPPED)


def descend(
    method: Method | Growing, problem, z, limits: Limits, callbacks: Callbacks = Callbacks(), stages: bool = True  # noqa: B008
) -> Run:
    """Iterate until the optimizer converges or stalls, or something else ends it; the best point is kept throughout.

    Without `stages` the whole problem comes at once.
    Raises: GuessFailed if the first point cannot be evaluated.
    """
    batch_size, history, stopped = callbacks.batch_size or BatchSize(1), History(z, callbacks), ""
    done = batch_size.run(method, problem, method.begin(z, stages=stages), limits.iterations + 1)
    try:
        while not stopped:
            for outcome in done.outcomes:
                stopped = stopped or history.see(outcome) or _ended(outcome, history, limits)
            if not stopped:
                left = limits.iterations + (-history.number if history.whole else 1)
                done = batch_size.run(method, problem, done.carry, left)
    except KeyboardInterrupt:
        stopped = INTERRUPTED
    z = jnp.asarray(history.z)  # once: to the host and back takes longer than some iterations
    return Run(z, history.loss, history.lines, history.first, history.best, stopped, history.whole)


def _ended(outcome: Outcome, history: History, limits: Limits) -> str:
    if bool(outcome.in_stage):
        return ""
    if bool(outcome.converged):
        return "converged"
    if bool(outcome.stalled):
        return "stalled"
    if history.idle >= limits.patience:
        return "no improvement"
    return "max_iterations" if history.number >= limits.iterations else ""
