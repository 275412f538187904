"""From a first point to the last descent of a fit: many starts, stages before the whole record, what a store held."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .descend import INTERRUPTED, STOPPED, Callbacks, GuessFailed, Limits, Run, descend
from .growing import Growing
from .optimizers import Method
from .problem import FitProblem
from .starts import RandomStarts, Starts, descend_from_all, spread_starts


class Way(NamedTuple):
    """How a fit descends."""

    method: Method | Growing
    problem: FitProblem
    limits: Limits
    callbacks: Callbacks

    def to_the_end(self, z: Float[Array, "unknown"], kept: bool) -> list[Run]:
        """All descents, the last one on the whole record; `kept` says that z is the best point of a fit before.

        If stages were ended by hand before the whole record, the last is only what it needs to report. A point that
        was kept is given up for a better one alone, and stages may lead to a worse one.
        """
        known = self._loss_at(z) if kept and isinstance(self.method, Growing) else float("inf")
        way = self._replace(callbacks=self.callbacks._replace(known=known))
        first = way._descend(z)
        if first.whole and first.loss <= known:
            return [first]
        best = first.z if known == float("inf") else z
        if first.whole and first.stopped not in (STOPPED, INTERRUPTED):
            return [first, way._descend(best, stages=False)]
        return [first, way.at(best, first.stopped)]

    def at(self, z: Float[Array, "unknown"], stopped: str) -> Run:
        """No descent, only what one that ended by hand in a stage or a start is reported by: the whole problem at z."""
        shortest = self._replace(limits=Limits(0, 1))
        last = even_if_interrupted(lambda: shortest._descend(z, stages=False))
        return last._replace(stopped=stopped)

    def _descend(self, z: Float[Array, "unknown"], stages: bool = True) -> Run:
        return descend(self.method, self.problem, z, self.limits, self.callbacks, stages)

    def _loss_at(self, z: Float[Array, "unknown"]) -> float:
        try:
            return descend(self.method, self.problem, z, Limits(0, 1), stages=False).loss
        except GuessFailed:
            return float("inf")


def from_many_starts(
    way: Way, z: Float[Array, "unknown"], starts: RandomStarts, tell: Callable[[int, float], None]
) -> tuple[list[Run], Starts]:
    """The last descent from the best of many starts, which all have been through stages; and what became of each.

    Raises: GuessFailed if the motions of all of them fail.
    """
    zs = spread_starts(way.problem, z, starts)
    several, interrupted = descend_from_all(way.method, way.problem, zs, way.limits.iterations, tell)
    if not bool(jnp.any(jnp.isfinite(several.loss))):
        raise GuessFailed(
            f"At least one of the {several.loss.size} starts must have a motion that reaches its end, but none has."
        )
    ended = zip(several.converged, several.z, strict=True)
    steady = [bool(small) and way.method.confirms(way.problem, end) for small, end in ended]
    several = several._replace(converged=jnp.array(steady))
    store, best = way.callbacks.store, several.z[jnp.argmin(several.loss)]
    keeper = store and store._replace(starts=max(several.loss.size, store.starts))
    method = way.method.method if isinstance(way.method, Growing) else way.method
    way = way._replace(method=method, callbacks=way.callbacks._replace(store=keeper))
    return [way.at(best, INTERRUPTED)] if interrupted else way.to_the_end(best, kept=False), several


def even_if_interrupted(work: Callable[[], Any]) -> Any:
    """What is made of a descent that has ended. Ctrl-C would only lose it, so the first one is let pass."""
    try:
        return work()
    except KeyboardInterrupt:
        return work()
