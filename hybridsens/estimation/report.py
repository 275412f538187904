"""A fit in words."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy import stats

from ..export.names import contact_names
from ..solution import SolutionEvents
from ..system import AbstractHybridSystem
from .cells import rows_told
from .descend import UNFINISHED, WHOLE, EventSequence

_BARELY = 0.9
"""Residuals larger than this part of the data's spread leave less than a fifth of its variance to the model."""
_ALONE = 0.9
"""A direction in which one parameter has this share is that parameter's own."""
_FAR = 7
"""A residual that is so many times as large as the spread of the others is no noise of one size with them."""
_FEW = 0.1
"""The largest part of a column that counts as outliers."""
_EXACT = 1e-6
"""Residuals smaller than this part of the data are rounding, and alike from sample to sample."""


def report(result: Any) -> str:
    """What `print` shows of a `FitResult`."""
    return "\n".join([*_head(result), "", *_parameters(result), "", *_events(result), *remarks(result)])


def remarks(result: Any) -> list[str]:
    """What is to be known beside the numbers, a sentence each: what the data do not determine, and what speaks against
    the intervals."""
    return [*_directions(result), *_doubts(result)]


def _head(result: Any) -> Iterator[str]:
    incomplete = "" if result.converged or result.stopped != "converged" else ", but lacks a measured event,"
    yield f"fit {result.stopped}{incomplete} after {_way(result)}, gradient norm {result.history[-1].gradient_norm:.3g}"
    known, heard = (int(np.sum(np.isfinite(r))) for r in (result.residuals, result.event_residuals))
    yield (
        f"{_count(known, 'observation')}, {_count(heard, 'event time')}; "
        f"residual spread {result.uncertainty.noise:.4g}"
    )
    if result.stopped in UNFINISHED:
        yield _advice(result)
    if result.failures:
        last = next(line.failure for line in reversed(result.history) if line.failure)
        yield f"{result.failures} trial points failed and were rejected; the last because {last}"
    if result.starts is not None:
        loss = np.asarray(result.starts.loss)
        near = int(np.sum(loss <= 1.01 * loss.min()))
        took = np.asarray(result.starts.iterations)
        yield (
            f"{loss.size} starts of {took.min()} to {took.max()} iterations: {near} ended within 1 % of the best "
            f"loss, {int(np.sum(np.isinf(loss)))} failed"
        )


def _count(number: int, of: str) -> str:
    return f"{number} {of}{'' if number == 1 else 's'}"


def _way(result: Any) -> str:
    """How many iterations it took, and from where to where; of several starts, that of the best of them."""
    if result.starts is None:
        first = result.history[0]  # of a growing horizon its loss is that of the beginning of the record alone
        before = f"{first.loss:.6g} -> " if first.stage == WHOLE else ""
        return f"{_count(result.iterations, 'iteration')}: loss {before}{result.loss:.6g}"
    took = int(result.starts.iterations[np.argmin(result.starts.loss)])
    return f"{_count(took, 'iteration')} from the best start and {result.iterations} more: loss {result.loss:.6g}"


def _advice(result: Any) -> str:
    """What to do about a fit that did not converge."""
    if result.on_bound:
        return f"It did not converge. Wider bounds of {', '.join(result.on_bound)} or other guesses may let it."
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


def _doubts(result: Any) -> Iterator[str]:
    """What speaks against the intervals: events that are missing, residuals that are no noise of the sigmas given."""
    if result.uncertainty.exact:
        yield (
            "residuals are zero to rounding and no sigmas were given, so nothing tells how uncertain the data are, and "
            "there are no intervals: give `sigma`"
        )
    yield from _unexplained(result)
    yield from _outliers(result)
    unit = "" if isinstance(result.scene, AbstractHybridSystem) else " s"
    for number in result.events_missing:
        yield (
            f"measured event {number} (at {result.data.event_times[number]:.6g}{unit}) is not in the fitted motion: it "
            "counts as if at the end of the horizon, and no derivative shows the way to it. Give a later `t1`, where "
            "it comes after the horizon, or a guess from which it comes"
        )
    for i, (name, correlation) in enumerate(result.residual_correlation.items()):
        known = np.isfinite(result.residuals[:, i])
        r, seen = result.residuals[known, i], result.data.values[known, i]
        if correlation > max(0.3, 4 / np.sqrt(max(r.size, 1))) and np.std(r) > _EXACT * np.std(seen):
            yield (
                f"residuals of {name} are alike from sample to sample (correlation {correlation:.2f}): the model "
                f"leaves something out, and the intervals are up to {_too_narrow(correlation):.1f} times too narrow"
            )
    if _larger_than_sigmas(result):
        noise = result.uncertainty.noise
        yield (
            f"residuals are {noise:.2g} times as large as their sigmas say: the model leaves something out, or the "
            "sigmas are too small; the intervals take them at their word"
        )


def _unexplained(result: Any) -> Iterator[str]:
    """Columns of which a constant would tell as much as the model; where sigmas allow for that, nothing moved."""
    if result.data.sigmas_known and not _larger_than_sigmas(result):
        return
    for name, residuals, values in zip(result.data.names, result.residuals.T, result.data.values.T, strict=True):
        known = np.isfinite(residuals)
        if known.sum() < 3:
            continue
        size, spread = np.sqrt(np.mean(residuals[known] ** 2)), np.std(values[known])
        if size > _BARELY * spread > 0:
            yield (
                f"residuals of {name} are as large ({size:.3g}) as the data's spread ({spread:.3g}): the model tells "
                "hardly more than a constant. Look at the units, at the columns and at the guess; or follow the record "
                "from its beginning in small steps, `strategy=GrowingHorizon(first=0.1, trust=0.25, steps=3)`"
            )


def _outliers(result: Any) -> Iterator[str]:
    """A few residuals that are far larger than the others, and were counted as if they were not."""
    if result.data.sigmas_known and np.isfinite(result.uncertainty.quantile_freedom):
        return  # a robust fit
    data = result.data
    sigmas = np.ones_like(data.values) if data.sigmas is None else data.sigmas
    columns = zip(data.names, (result.residuals / sigmas).T, (data.values / sigmas).T, strict=True)
    for name, residuals, values in columns:
        known = np.isfinite(residuals)
        if not known.any():
            continue
        # About their median, since outliers draw the fit away from the others.
        spread = stats.median_abs_deviation(residuals[known], scale=float(stats.norm.ppf(0.75)))
        far = np.flatnonzero(known & (np.abs(residuals - np.median(residuals[known])) > _FAR * spread))
        if spread > _EXACT * np.std(values[known]) and 0 < far.size <= _FEW * known.sum():
            yield (
                f"residuals of {name} are more than {_FAR} times as large as most others at {rows_told(far)}. If these "
                "are outliers, leave them out (nan, with `missing=\"skip\"`), or give `sigma` and `robust=3`; they "
                "widen all intervals"
            )


def _larger_than_sigmas(result: Any) -> bool:
    """Whether sigmas were given, and the residuals are larger than they allow."""
    freedom, noise = result.uncertainty.freedom, result.uncertainty.noise
    return bool(result.data.sigmas_known and noise > 1.1 and stats.chi2.sf(freedom * noise**2, freedom) < 1e-6)


def _too_narrow(correlation: float) -> float:
    """Of the mean of noise whose correlations fall off geometrically."""
    return float(np.sqrt((1 + correlation) / max(1 - correlation, 1e-2)))


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
    shown = ", ".join(name(*event) for event in sequence[:8])
    return f"{len(sequence)} ({shown}{', ...' if len(sequence) > 8 else ''})"
