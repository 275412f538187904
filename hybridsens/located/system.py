"""A hybrid system each of whose comparisons is a guard: what jumps or has a kink there is a mode."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int

from ..system_checks import WrappedSystem, as_written
from .comparisons import Comparisons
from .outcomes import Outcomes


class LocatedMode(eqx.Module):
    """Mode of a system whose comparisons are events."""

    own: Any
    """The mode that the user's system speaks of."""
    outcomes: Outcomes
    """Those of the comparisons."""


class LocatedSystem(WrappedSystem):
    """A system whose comparisons of (t, x) in flow, guards and running cost keep their outcomes within a mode.

    Guards 0, 1, ... are those of the system, those of the comparisons follow. Then come the scheduled times."""

    running_cost: Callable[..., Any] | None
    """Of the system as the user wrote it."""
    guard_count: int = eqx.field(static=True)
    """Guards of the user's system."""

    def begin(self, t, x, own) -> LocatedMode:
        """The mode in which a motion from (t, x) begins."""
        return LocatedMode(own, self._comparisons(t, x, own).outcomes())

    def flow(self, t, x, mode: LocatedMode):
        return self._comparisons(t, x, mode.own).held(0, mode.outcomes)

    def guards(self, t, x, mode: LocatedMode):
        compared = self._comparisons(t, x, mode.own)
        return jnp.concatenate([compared.held(1, mode.outcomes), compared.guards(mode.outcomes)])

    def cost(self, t, x, mode: LocatedMode):
        """Running cost."""
        return self._comparisons(t, x, mode.own).held(2, mode.outcomes)

    def transition(self, event, t, x, mode: LocatedMode):
        """That of the system; or an outcome changes, and nothing else. One that a jump of x changes comes at once."""
        number = event - self.guard_count
        of_comparison = (number >= 0) & (number < mode.outcomes.guard_count)

        def own_transition():
            asked = jnp.where(number < 0, event, event - mode.outcomes.guard_count)
            after, own = self.system.transition(asked, t, x, mode.own)
            cast = lambda new, old: jnp.asarray(new, old.dtype)
            return jax.tree.map(cast, after, x), jax.tree.map(cast, own, mode.own)

        x, own = lax.cond(of_comparison, lambda: (x, mode.own), own_transition)
        return x, self._after(number, *lax.stop_gradient((t, x)), LocatedMode(own, mode.outcomes))

    def _after(self, number, t, x, mode: LocatedMode) -> LocatedMode:
        """The mode with the outcomes after guard `number` of the comparisons fell, or an event of the system: that may
        put a count in x on the very number that it is compared with, as another outcome does to max(a, b) == a."""
        compared = self._comparisons(t, x, mode.own)
        outcomes = compared.after(number, mode.outcomes)
        alone = self.guard_count == 0 and self.system.scheduled_times(x, mode.own) is None
        if alone and not compared.nested:
            return LocatedMode(mode.own, outcomes)
        differences = lambda t, x: self._comparisons(t, x, mode.own).differences(outcomes)
        flow = compared.held(0, outcomes)
        _, rates = jax.jvp(differences, (t, x), (jnp.ones_like(t), flow))
        return LocatedMode(mode.own, compared.arrived(number, outcomes, rates))

    def scheduled_times(self, x, mode: LocatedMode):
        return self.system.scheduled_times(x, mode.own)

    def _comparisons(self, t, x, own) -> Comparisons:
        def functions(t, x, own):
            flow, guards = self.system.flow(t, x, own), self.system.guards(t, x, own)
            return flow, guards, None if self.running_cost is None else self.running_cost(as_written(self), t, x, own)

        return Comparisons(functions, (t, x), own)


def located(system: Any, running_cost: Callable | None, guard_count: int, instant: tuple) -> tuple[Any, ...]:
    """The system with its comparisons as guards, its running cost, its number of guards and its first mode; all as
    they were where nothing is compared. `instant` is (t, x, mode)."""
    made = LocatedSystem(system, running_cost, guard_count)
    mode = made.begin(*instant)
    if mode.outcomes.guard_count == 0:
        return system, running_cost, guard_count, instant[2]
    return made, None if running_cost is None else _cost, guard_count + mode.outcomes.guard_count, mode


def _cost(system: LocatedSystem, t, x, mode: LocatedMode):
    return system.cost(t, x, mode)


def asked_for_cost(system: Any) -> Any:
    """The system that a running cost is given: the one that the user wrote, unless its comparisons are held."""
    return system if isinstance(system, LocatedSystem) else as_written(system)


def own_mode(mode: Any) -> Any:
    """The mode that the user's system speaks of."""
    return mode.own if isinstance(mode, LocatedMode) else mode


def own_guards(of_each: Bool[Array, "guard"], system: Any) -> Bool[Array, "own"]:
    """Of each guard, without those of comparisons."""
    return of_each[: system.guard_count] if isinstance(system, LocatedSystem) else of_each


def own_number(flat_number: Int[Array, "*event"], system: Any, guards: int, scheduled: int) -> Int[Array, "*event"]:
    """The number of an event as the user's system counts: comparisons come last, behind the scheduled times.

    `guards` counts those of comparisons too."""
    if not isinstance(system, LocatedSystem):
        return flat_number
    own = system.guard_count
    behind = jnp.where(flat_number < guards, flat_number + scheduled, flat_number - (guards - own))
    return jnp.where(flat_number < own, flat_number, behind)
