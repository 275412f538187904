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


class LocatedMode(eqx.Module):
    """Mode of a system whose comparisons are events."""

    own: Any
    """The mode that the user's system speaks of."""
    above: Bool[Array, "surface"]
    """The outcome of each comparison, greater > less."""


class LocatedSystem(WrappedSystem):
    """A system whose comparisons of (t, x) in flow, guards and running cost keep their outcomes within a mode.

    Guards 0, 1, ... are those of the system; the difference of each comparison follows, positive on the side on which
    the motion is. Then come the scheduled times."""

    running_cost: Callable[..., Any] | None
    """Of the system as the user wrote it."""
    guard_count: int = eqx.field(static=True)
    """Guards of the user's system."""

    def begin(self, t, x, own) -> LocatedMode:
        """The mode in which a motion from (t, x) begins."""
        compared = self._comparisons(t, x, own)
        return LocatedMode(own, compared.outcomes(lax.stop_gradient(compared.differences())))

    def flow(self, t, x, mode: LocatedMode):
        return self._comparisons(t, x, mode.own).held(0, mode.above)

    def guards(self, t, x, mode: LocatedMode):
        compared = self._comparisons(t, x, mode.own)
        differences = compared.differences(mode.above)
        return jnp.concatenate([compared.held(1, mode.above), sided(differences, mode.above)])

    def cost(self, t, x, mode: LocatedMode):
        """Running cost."""
        return self._comparisons(t, x, mode.own).held(2, mode.above)

    def transition(self, event, t, x, mode: LocatedMode):
        """That of the system; or an outcome changes, and nothing else. One that a jump of x changes comes at once."""
        changed = jnp.arange(mode.above.size) == event - self.guard_count

        def own_transition():
            number = jnp.where(event < self.guard_count, event, event - mode.above.size)
            after, own = self.system.transition(number, t, x, mode.own)
            cast = lambda new, old: jnp.asarray(new, old.dtype)
            return jax.tree.map(cast, after, x), LocatedMode(jax.tree.map(cast, own, mode.own), mode.above)

        turned = lambda: (x, LocatedMode(mode.own, mode.above ^ changed))
        x, after = lax.cond(jnp.any(changed), turned, own_transition)
        return x, self._settled(changed, *lax.stop_gradient((t, x)), after)

    def _settled(self, changed, t, x, mode: LocatedMode) -> LocatedMode:
        """The mode with the outcomes of what stands still now; so does a count in x that a transition of the system
        has put on the very number that it is compared with."""
        compared = self._comparisons(t, x, mode.own)
        mode = LocatedMode(mode.own, compared.settled(mode.above, changed))
        if self.guard_count == 0 and self.system.scheduled_times(x, mode.own) is None:
            return mode
        differences = lambda t, x: self._comparisons(t, x, mode.own).differences(mode.above)
        now, rate = jax.jvp(differences, (t, x), (jnp.ones_like(t), self.flow(t, x, mode)))
        waits = (now == 0) & (rate == 0) & ~changed
        return LocatedMode(mode.own, jnp.where(waits, compared.outcomes(now), mode.above))

    def scheduled_times(self, x, mode: LocatedMode):
        return self.system.scheduled_times(x, mode.own)

    def _comparisons(self, t, x, own) -> Comparisons:
        def functions(t, x, own):
            flow, guards = self.system.flow(t, x, own), self.system.guards(t, x, own)
            return flow, guards, None if self.running_cost is None else self.running_cost(as_written(self), t, x, own)

        return Comparisons(functions, (t, x), own)


def sided(differences, above):
    """Differences as guards, positive on the side on which the motion is; a bound at infinity stays away."""
    guards = jnp.where(above, differences, -differences)
    return jnp.where(jnp.isinf(guards), 1.0, guards)


def located(system: Any, running_cost: Callable | None, guard_count: int, instant: tuple) -> tuple[Any, ...]:
    """The system with its comparisons as guards, its running cost, its number of guards and its first mode; all as
    they were where nothing is compared. `instant` is (t, x, mode)."""
    made = LocatedSystem(system, running_cost, guard_count)
    mode = made.begin(*instant)
    if mode.above.size == 0:
        return system, running_cost, guard_count, instant[2]
    return made, None if running_cost is None else _cost, guard_count + mode.above.size, mode


def _cost(system: LocatedSystem, t, x, mode: LocatedMode):
    return system.cost(t, x, mode)


def asked_for_cost(system: Any) -> Any:
    """The system that a running cost is given: the one that the user wrote, unless its comparisons are held."""
    return system if isinstance(system, LocatedSystem) else as_written(system)


def own_mode(mode: Any) -> Any:
    """The mode that the user's system speaks of."""
    return mode.own if isinstance(mode, LocatedMode) else mode


def own_number(flat_number: Int[Array, "*event"], system: Any, guards: int, scheduled: int) -> Int[Array, "*event"]:
    """The number of an event as the user's system counts: comparisons come last, behind the scheduled times.

    `guards` counts those of comparisons too."""
    if not isinstance(system, LocatedSystem):
        return flat_number
    own = system.guard_count
    behind = jnp.where(flat_number < guards, flat_number + scheduled, flat_number - (guards - own))
    return jnp.where(flat_number < own, flat_number, behind)
