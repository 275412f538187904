"""A fit in words."""

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..export.names import contact_names
from ..solution import SolutionEvents
from .descend import UNFINISHED, WHOLE, EventSequence
from .doubts import doubts

_ALONE = 0.9
"""A direction in which one parameter has this share is that parameter's own."""


def report(result: Any) -> str:
    """What `print` shows of a `FitResult`."""
    return "\n".join([*_head(result), "", *_parameters(result), "", *_events(result), *remarks(result)])


def remarks(result: Any) -> list[str]:
    """What is to be known beside the numbers, a sentence each: what the data do not determine, and what speaks against
    the intervals."""
    return [*_directions(result), *doubts(result)]


def _head(result: Any) -> Iterator[str]:
    incomplete = ""
    if result.stopped == "converged" and not result.converged:
        lacks = result.events_missing.size > 0
        incomplete = ", but lacks a measured event," if lacks else ", but nothing that was measured tells a parameter,"
    yield f"fit {result.stopped}{incomplete} after {_way(result)}, gradient norm {_slope(result):.3g}"
    known, heard = (int(np.sum(np.isfinite(r))) for r in (result.residuals, result.event_residuals))
    yield (
        f"{_count(known, 'observation')}, {_count(heard, 'event time')}; "
        f"residual spread {result.uncertainty.noise:.4g}"
    )
    if result.stopped in UNFINISHED:
        yield _advice(result)
    if result.failures:
        last = next(line.failure for line in reversed(result.history) if line.failure)
        yield f"{result.failures} trial points failed and were rejected ({_BOUNDS}); the last because {last}"
    if result.starts is not None:
        yield _starts(result.starts)


def _slope(result: Any) -> float:
    """The norm of the gradient at the best point, which need not be the last one."""
    best = (line for line in reversed(result.history) if line.stage == WHOLE and line.loss <= result.loss)
    return next(best, result.history[-1]).gradient_norm


_BOUNDS = "`bounds` keep to where motions exist"


def _starts(starts: Any) -> str:
    """How many starts agree on the best loss: one alone says little of whether there is a lower one."""
    loss, took = np.asarray(starts.loss), np.asarray(starts.iterations)
    near, failed = int(np.sum(loss <= 1.01 * loss.min())), int(np.sum(np.isinf(loss)))
    reached = "1 alone ended within 1 % of the best loss, so take more" if near == 1 < loss.size else (
        f"{near} ended within 1 % of the best loss"
    )  # fmt: skip
    why = f" ({_BOUNDS})" if failed else ""
    return f"{loss.size} starts of {took.min()} to {took.max()} iterations: {reached}; {failed} failed{why}"


def _count(number: int, of: str) -> str:
    return f"{number} {of}{'' if number == 1 else 's'}"


def _way(result: Any) -> str:
    """How many iterations it took, and from where to where; of several starts, that of the best of them."""
    if result.starts is None:
        first = result.history[0]  # of a growing horizon its loss is that of the beginning of the record alone
        before = f"{first.loss:.6g} -> " if first.stage == WHOLE else ""
        return f"{_count(result.iterations, 'iteration')}: loss {before}{result.loss:.6g}"
    took = int(result.starts.iterations[np.argmin(result.starts.loss)])
    more = f", {result.iterations} more with the best" if result.iterations else ""
    return f"{_count(took, 'iteration')} of the best of {result.starts.loss.size} starts{more}: loss {result.loss:.6g}"


def _advice(result: Any) -> str:
    """What to do about a fit that did not converge."""
    if result.on_bound:
        return f"It did not converge. Wider bounds of {', '.join(result.on_bound)} or other guesses may let it."
    losses = [line.loss for line in result.history]
    if all(line.accepted for line in result.history) and np.ptp(losses) <= 1e-3 * losses[0]:
        return (
            "It did not converge: the optimizer's steps are too short to lead anywhere. Give it longer ones, or "
            "`sigma`, in which the loss is counted, or take the default optimizer."
        )
    no_way = "" if result.stopped == "max_iterations" else (
        " Where an event passes the time of a measurement the loss jumps, and no step leads across: begin on the other "
        "side."
    )  # fmt: skip
    return (
        "It did not converge. Where the guess is far off, `strategy=GrowingHorizon()` fits the beginning of the record "
        "first, and `starts=` begins at several points." + no_way
    )


def _parameters(result: Any) -> Iterator[str]:
    width = max(12, *map(len, result.labels))
    yield f"{'parameter':<{width}} {'guess':>12} {'value':>12} {'std error':>12} {'95 % interval':>28}"
    intervals, errors = result.intervals(), result.standard_errors
    for label, guess, value in zip(result.labels, result.guess, result.values, strict=True):
        low, high = intervals[label]
        interval = f"[{low:.6g}, {high:.6g}]"
        yield f"{label:<{width}} {guess:>12.6g} {value:>12.6g} {errors[label]:>12.3g} {interval:>28}"


def _events(result: Any) -> Iterator[str]:
    start, end, names = result.sequence_start, result.sequence_end, _names(result)
    yield f"events at the guess: {_sequence(start, names)}"
    yield f"events at the end:   {'the same' if start == end else _sequence(end, names)}"
    if result.sequence_changes:
        yield (
            f"the event sequence changed at {_count(result.sequence_changes, 'accepted step')}: the loss is only "
            "piecewise smooth"
        )


def _directions(result: Any) -> Iterator[str]:
    for label in result.on_bound:
        yield f"on its bound: {label}, which has no interval; those of other parameters hold it there"
    for label in result.uncertainty.unseen:
        yield f"not determined by the data: {label}, since nothing that was measured depends on it"
    for direction in result.uncertainty.null_directions:
        yield f"not determined by the data (relative change): {_direction(direction)}"
    for error, direction in result.weak_directions():
        yield _weak(error, direction, dict(zip(result.labels, result.values, strict=True)), result.standard_errors)
    pairs = np.argwhere(np.triu(np.abs(np.nan_to_num(result.correlation)) > 0.95, 1))
    for i, j in pairs:
        yield f"strongly correlated: {result.labels[i]} and {result.labels[j]} ({result.correlation[i, j]:+.3f})"


def _weak(error: float, direction: dict[str, float], values: dict[str, float], errors: dict[str, float]) -> str:
    """A direction of large relative error. One parameter alone has that where its value is near 0, and may be known
    well: 0 is a value like others of a logarithm, or of an angle."""
    label = max(direction, key=lambda label: abs(direction[label]))
    if abs(direction[label]) < _ALONE:
        return f"hardly determined (standard error {error:.2g} of relative change): {_direction(direction)}"
    return (
        f"hardly told from 0: {label}, which is {values[label]:.3g} with a standard error of {errors[label]:.2g} (no "
        "matter where 0 is a value like others, as of a logarithm or an angle)"
    )


def _direction(direction: dict[str, float]) -> str:
    shares = sorted(direction.items(), key=lambda item: -abs(item[1]))
    return ", ".join(f"{label} {share:+.2f}" for label, share in shares if abs(share) > 0.05)


def _names(result: Any) -> Callable[[str, int], str]:
    """(kind, number) -> what the report calls an event: by the name of its contact, or of the event of a system."""
    events = result.trajectory.events
    if isinstance(events, SolutionEvents):
        return lambda kind, number: f"{kind} {number}" if events.names is None else events.names[number]
    contacts = contact_names(result.scene, np.shape(events.impulse)[-1])
    return lambda kind, number: f"{kind} {number if kind == 'switch' else contacts[number]}"


def _sequence(sequence: EventSequence, name: Callable[[str, int], str]) -> str:
    if not sequence:
        return "none"
    runs = [(len(list(run)), label) for label, run in itertools.groupby(name(*event) for event in sequence)]
    shown = ", ".join(label if count == 1 else f"{count} x {label}" for count, label in runs[:8])
    return f"{len(sequence)} ({shown}{', ...' if len(runs) > 8 else ''})"
