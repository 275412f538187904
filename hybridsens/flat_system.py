"""The one interface between a model and the method: a hybrid system with a flat state.

A hybrid system flows, x' = f(t, x) in a mode, until one of its guards falls through zero; then the state jumps,
x+ = R(t, x-), and the mode changes. Everything in `forward/` and `adjoint/` is written against this page alone.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .observables import EventMarks, EventStates
from .status import Status

Mode = PyTree[Array]
"""The discrete state: any PyTree of arrays of fixed shape. It is never differentiated."""

START, FLOW_JUMP = -1, -2
"""Numbers of events that are no guard's. Guards are numbered 0, 1, ... and scheduled times go on behind them; jump
times are numbered -2, -3, ..., all of which are decided as a `FLOW_JUMP`. The beginning of a motion is its `START`,
which is recorded nowhere: in a record -1 is a row without an event."""


class Decision(eqx.Module):
    """What is decided at an event, before anything moves: all that is discrete about a transition."""

    mode: Mode
    """The mode after the event."""
    kind: Int[Array, ""]
    """What the event is, as a number that the system gives a meaning."""
    detail: Any = None
    """What else `reset` has to know (which impulses act, say)."""
    grazing: Bool[Array, ""] | bool = False
    """Whether the guard was met so gently that the tolerances cannot tell an event from a near miss."""
    status: Status = eqx.field(default_factory=lambda: Status.running)
    """`Status.running`, or why the motion must not go on."""
    first_step_bound: Float[Array, ""] | float = float("inf")
    """Upper bound of the first step after the event, so that a short bounce is not skipped."""
    at_once: Bool[Array, ""] | bool = False
    """Whether the event before caused this one, by putting its guard below zero: they share their time."""
    silent: Bool[Array, ""] | bool = False
    """Whether a guard has risen above 0, and is watched again: nothing else happens, and nothing is reported."""
    order_matters: Bool[Array, ""] | bool = False
    """Whether guards met at one instant, and another order would have another outcome: derivatives are one-sided."""


class StepEnds(NamedTuple):
    """A step from (t0, x0) to (t1, x1), and its guards and their rates at both ends."""

    t0: Float[Array, ""]
    x0: Float[Array, "state"]
    guard0: Float[Array, "guard"]
    rate0: Float[Array, "guard"]
    t1: Float[Array, ""]
    x1: Float[Array, "state"]
    guard1: Float[Array, "guard"]
    rate1: Float[Array, "guard"]
    error: Float[Array, "state"]
    """The solver's estimate of what the step may be wrong by."""
    order: Any
    """At which power of the step that estimate falls."""


class Searched(NamedTuple):
    """What a search of the inside of a step found, in fractions of the step."""

    crossing: Float[Array, ""]
    """Where a guard falls through zero; inf where none does before `reached`."""
    reached: Float[Array, ""]
    """Up to where no guard is below zero."""
    grazes: Bool[Array, ""]
    """Whether one turns before, so near zero that rounding decides whether it falls through it."""

    @classmethod
    def nothing(cls, t0) -> "Searched":
        """No guard falls, or none is looked for, in all of a step that starts at `t0`."""
        return cls(jnp.full_like(t0, jnp.inf), jnp.ones_like(t0), jnp.array(False))

    @classmethod
    def first_of(cls, searches: "list[Searched]") -> "Searched":
        """What several searches of one step, each for other guards, found together."""
        crossings, reached, grazes = map(jnp.stack, zip(*searches, strict=True))
        return cls(jnp.min(crossings), jnp.min(reached), jnp.any(grazes))


class AbstractFlatSystem(eqx.Module):
    """x' = flow(t, x, mode) until a guard falls through 0; then x+ = reset(decision, t, x-).

    The array leaves of the module are the parameters. The state x is one flat vector, so that a step is plain
    arithmetic; event number i is guard number i falling through zero.
    """

    @abc.abstractmethod
    def flow(self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Float[Array, "state"]:
        """Time derivative of the state in a mode."""

    @abc.abstractmethod
    def guards(self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Float[Array, "guard"]:
        """Event functions h(t, x) of a mode, of shape (guard,): positive inside, an event where one falls to 0."""

    @abc.abstractmethod
    def decide(self, event: Int[Array, ""], t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Decision:
        """The discrete part of a transition: next mode and which law acts. Never differentiated.

        At the `START` the mode in which a motion from (t, x) begins, and at a `FLOW_JUMP` the one in which it goes on.
        """

    @abc.abstractmethod
    def reset(
        self, decision: Decision, t: Float[Array, ""], x: Float[Array, "state"]
    ) -> tuple[Float[Array, "state"], PyTree[Array]]:
        """The smooth part: the state just after, R(t, x-), and what the event emits (an impulse, say)."""

    def project(self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Float[Array, "state"]:
        """Put a state that drifted by rounding and truncation back on its mode's constraints; by default nothing."""
        del t, mode
        return x

    def projects(self, mode: Mode) -> bool:
        """Whether `project` may move a state. By default it does not."""
        del mode
        return False

    def project_with_error(
        self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode
    ) -> tuple[Float[Array, "state"], Float[Array, "state"]]:
        """`project`, and how far it moved the state: that is an error of the step that led there.

        Where the constraints are smooth that is no larger than the solver's own estimate; across a corner of them it
        stays finite however short the step is."""
        projected = self.project(t, x, mode)
        return projected, projected - x

    def jump_times(self) -> Float[Array, "jump"] | None:
        """Times at which the flow has a kink or a jump: steps end there, and begin anew. None, the default, for none.

        They may be made from parameters: what a jump f- - f+ adds to a gradient by its time is part of it."""
        return None

    def scheduled_times(self, x: Float[Array, "state"], mode: Mode) -> Float[Array, "time"] | None:
        """Times of events that are known: event number i beyond those of the guards. None, the default, for none."""
        del x, mode
        return None

    def expected(self, mode: Mode) -> Bool[Array, "time"]:
        """Which scheduled times are still to come; asked of a system that has some."""
        raise NotImplementedError

    def silent_room(self, max_events: int) -> int:
        """How many silent events there may be beside `max_events` others. By default there are none."""
        del max_events
        return 0

    def is_silent(self, event: Int[Array, ""], mode: Mode) -> Bool[Array, ""] | bool:
        """Whether an event is a silent one; asked of a system that has `silent_room`."""
        del event, mode
        return False

    def fires_at_once(self, event: Int[Array, ""], mode: Mode) -> Bool[Array, ""] | bool:
        """Whether the event before has put guard `event` below zero. Then it may be the same one again."""
        del event, mode
        return False

    def ends_with(self, states: EventStates, marks: EventMarks) -> Bool[Array, ""] | bool:
        """Whether the motion ends with an event, before t1. By default it does not."""
        del states, marks
        return False

    def stuck(self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Status:
        """Why no step can be taken from (t, x), however short; asked once, where a motion ends like that."""
        del t, x, mode
        return Status.step_size_underflow

    def unconstrained(self, mode: Mode) -> "tuple[Bool[Array, ''], AbstractFlatSystem] | None":
        """Whether a mode constrains nothing, and the system as it moves then: the same motion by a shorter flow.

        None, the default, where there is no shorter one. Both are asked for within one compiled step: the system
        returned must have the array leaves of this one.
        """
        del mode
        return None

    def guards_and_rates(
        self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode
    ) -> tuple[Float[Array, "guard"], Float[Array, "guard"]]:
        """Guards and their rates h' = h_t + h_x f along the flow."""
        flow = self.flow(t, x, mode)
        return jax.jvp(lambda t, x: self.guards(t, x, mode), (t, x), (jnp.ones_like(t), flow))

    def searches(self, t: Float[Array, ""], x: Float[Array, "state"]) -> bool:
        """Whether steps are searched for events that their ends do not show. By default they are not: what guards and
        their rates at the ends tell is all that is known."""
        del t, x
        return False

    def search(self, step: StepEnds, mode: Mode, tolerance: Float[Array, "guard"], wanted) -> Searched:
        """Where inside a step a guard falls below -tolerance; looked for only where `wanted`, since it may cost much.

        Asked of a system that `searches`."""
        raise NotImplementedError

    def scales(
        self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode
    ) -> tuple[Float[Array, "guard"] | float, Float[Array, "guard"] | float]:
        """Sizes of the numbers that guards and their rates are differences of: what their rounding is relative to.

        With the default, 0, a guard is trusted to the last bit."""
        del t, x, mode
        return 0.0, 0.0

    def clock_scales(self, t: Float[Array, ""], mode: Mode) -> Float[Array, "guard"] | float:
        """Sizes by which guards move while the clock comes to t, where `scales` leaves them out: a guard is rounded as
        the clock is."""
        del t, mode
        return 0.0

    def turning_scales(
        self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode
    ) -> tuple[Float[Array, "guard"], Float[Array, "guard"]] | None:
        """The same of guards that turn at zero without passing it, where no first derivative tells any size.

        None, the default, for guards that turn nowhere or that `grazing_depth` judges."""
        del t, x, mode
        return None

    def grazing_depth(self, mode: Mode) -> Float[Array, "guard"] | float:
        """A minimum of a guard that stays above zero by less than this cannot be told from an event."""
        del mode
        return -1.0
