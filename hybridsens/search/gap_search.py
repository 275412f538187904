"""A search for a guard that dips below zero inside a step, by bounds instead of samples.

A step of free flight may be very long, and a curved gap may dip below zero and come back inside it, unseen from its
ends; so may a clock. The search walks along the step and passes a stretch only when bounds prove that no guard is below
zero on it; else the stretch is halved. To find the events that samples miss by interval arithmetic is an idea of Park
and Barton (State event location in differential-algebraic models, 1996). What has no bounds is sampled, and told of.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..flat_system import Searched, StepEnds
from ..interval.arithmetic import Interval, point
from ..interval.enclosure import enclose
from ..interval.kind import Kind, kinds
from ..numerics.tolerances import time_resolution
from ..validation.caller import warn_caller
from ..xla.once import computed_once
from .path import Path
from .stretch import Nearness, Stretch

Gap = Callable[[Array, Array], Array]
"""(t, q) -> guards: gaps of a scene, or guards of any system with its state for q."""

MOST_LOOKS = 512
"""How many stretches of a step are looked at before the search is given up."""
SHORTEST_CUT = 1 / 32
"""Where a gap turns near zero at once, the step is cut at this fraction."""
COARSEST = 1 / 16
"""Longest stretch, as a fraction of the step, where a gap has no bounds and is sampled."""


class Walk(NamedTuple):
    """How far a step has been searched."""

    s: Float[Array, ""]
    """No gap is below zero before this fraction of the step."""
    width: Float[Array, ""]
    """Of the stretch to look at next."""
    gap: Float[Array, "contact"]
    """Gaps at s."""
    rate: Float[Array, "contact"]
    """Their rates there, by fractions of the step."""
    looks: Int[Array, ""]
    """How many stretches were looked at."""
    crossing: Float[Array, ""]
    """Where a gap falls through zero; inf where none is known to."""
    cut: Float[Array, ""]
    """Where to end the step, because a gap turns so near zero in it that only a shorter one could tell whether it falls
    through it; inf where none does."""
    grazes: Bool[Array, ""]
    """Whether a gap has turned so near zero that no step could tell."""

    @property
    def goes_on(self) -> Bool[Array, ""]:
        """Whether there is more to look at."""
        return (self.s < 1) & (self.looks < MOST_LOOKS) & jnp.isinf(self.crossing) & jnp.isinf(self.cut)

    def after(self, stretch: Stretch, nearness: Nearness, widest: float, finest) -> "Walk":
        """Pass the stretch, or end at the crossing in it, or halve it; one of the finest width is passed anyhow."""
        tolerance, searched = nearness.tolerance, nearness.depth >= 0
        least = stretch.least()
        clear = (least >= -tolerance) | ~searched
        found = jnp.any(~clear) & jnp.all(clear | stretch.falls(tolerance))
        turns = stretch.turns(least, nearness)
        passed = (jnp.all(clear) & ~turns.unclear) | (~found & (self.width <= finest))
        pick = lambda new, old: jnp.where(passed, new, old)
        s = pick(self.s + self.width, self.s)
        wider = jnp.minimum(jnp.minimum(2 * self.width, widest), 1 - s)
        crossing = jnp.where(found, self.s + self.width * stretch.crossing(~clear), jnp.inf)
        gap, rate = pick(stretch.gap1, self.gap), pick(stretch.rate1, self.rate)
        # At least half of the step is cut off: the shorter it is, the less the cubic through its ends is off by.
        end = jnp.clip(self.s + self.width, SHORTEST_CUT, 0.5)
        cut = jnp.where(passed & turns.rough, end, jnp.inf)
        grazes = self.grazes | (passed & turns.touch)
        return Walk(s, pick(wider, self.width / 2), gap, rate, self.looks + 1, crossing, cut, grazes)


def gap_kinds(gap: Gap, t, q):
    """How each gap depends on (t, q), as an array of `Kind`, and the trace of the gaps that tells."""
    trace = jax.make_jaxpr(gap)(t, q)
    return kinds(trace, [np.full(x.shape, Kind.AFFINE) for x in trace.in_avals]), trace


def search_gaps(gap: Gap, path: Path, step: StepEnds, nearness: Nearness, wanted) -> Searched:
    """First fall of one of the gaps below zero inside a step, or the first turn too near to it.

    Bounds are those of interval arithmetic. A gap made by an operation without a rule there (a table, a loop, a
    special function) is sampled at 16 places of the step or more, and its second derivative is guessed from these.
    """
    kind, trace = gap_kinds(gap, path.t0, path.coefficients[0])
    look = _looker(gap, path, step, trace, kind == Kind.UNKNOWN)
    widest = COARSEST if (kind == Kind.UNKNOWN).any() else 1.0
    finest = time_resolution(step.t1, 1) / path.h
    zero = jnp.zeros_like(path.t0)
    s = jnp.where(wanted, zero, 1)  # a search that is not wanted begins at the end
    start = Walk(
        s, zero + widest, step.guard0, path.h * step.rate0, jnp.array(0), zero + jnp.inf, zero + jnp.inf,
        jnp.array(False),
    )  # fmt: skip
    turn = lambda walk: walk.after(look(walk), nearness, widest, finest)
    walk = lax.while_loop(lambda walk: walk.goes_on, turn, start)
    return Searched(walk.crossing, jnp.minimum(walk.s, walk.cut), walk.grazes)


def search_guards(guards: Gap, flow: Gap, step: StepEnds, speed, tolerance, wanted) -> Searched:
    """First fall of any function of (t, x) below zero inside a step: along the cubic through the ends of the step, and
    within what that may be off. `speed` (guard,) is the largest rate of each that is known.

    How exactly a guard is known is not: where one turns near zero, the step is cut until rounding alone is left."""

    def search():
        path = Path.through(step.t0, step.t1, step.x0, flow(step.t0, step.x0), step.x1, flow(step.t1, step.x1))
        fastest = jnp.maximum(speed, jnp.maximum(jnp.abs(step.rate0), jnp.abs(step.rate1)))
        doubt, least = (path.doubt(error, step.order) * path.h * fastest for error in (step.error, 0 * step.error))
        found = search_gaps(guards, path, step, Nearness(tolerance, doubt, 2 * least), wanted)
        return found._replace(grazes=jnp.array(False))

    return lax.cond(wanted, search, lambda: Searched.nothing(step.t0))


def _looker(function: Gap, path: Path, step: StepEnds, trace, unknown: np.ndarray) -> Callable[[Walk], Stretch]:
    """The function that looks at the stretch that a walk has come to. The step's end is known already."""

    def look(walk: Walk) -> Stretch:
        s, w = walk.s, walk.width
        last = s + w >= 1
        t, q, slope = path.at(s + w)
        gap, rate = jax.jvp(function, (t, q), (path.h, slope))
        gap, rate = jnp.where(last, step.guard1, gap), jnp.where(last, path.h * step.rate1, rate)
        jet = enclose(trace, path.over(s, w), functools.partial(computed_once, walk.looks >= 0))  # always true
        bend = jet.bend or point(jnp.zeros_like(gap))
        if unknown.any():
            guess = guessed_bend(walk.gap, walk.rate * w, gap, rate * w)
            bend = Interval(*(jnp.where(unknown, x / (w * w), y) for x, y in zip(guess, bend, strict=True)))
        return Stretch(w, walk.gap, walk.rate, gap, rate, jet.value.low, bend)

    return look


def guessed_bend(g0, d0, g1, d1):
    """Guessed bounds of a second derivative: those of the cubic through a stretch's ends, put twice as far apart."""
    rise = g1 - g0
    first, second = 6 * rise - 4 * d0 - 2 * d1, -6 * rise + 2 * d0 + 4 * d1
    middle, radius = 0.5 * (first + second), jnp.abs(first - second)
    return middle - radius, middle + radius


def warn_of_sampled(title: str, function: Gap, t, x) -> None:
    """Say so where dips of an entry of a function of (t, x) inside a step are only sampled: a short one may be stepped
    over. `title` is what the entries are called, as in "Gaps"."""
    unknown = np.flatnonzero(gap_kinds(function, t, x)[0] == Kind.UNKNOWN).tolist()
    if unknown:
        warn_caller(
            f"{title} {unknown} are read from a table or made by a loop or by an operation without known bounds, so a "
            f"dip inside a step is looked for at {round(1 / COARSEST)} places of it or more, and a shorter one is "
            "missed. Give `max_step`, the time that the shortest dip lasts (t1 - t0 if there is none)."
        )
