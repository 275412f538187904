"""The one interface between physics and method: a hybrid system.

A hybrid system flows, x' = f(t, x) in a mode, until one of its guards falls through zero; then the state jumps,
x+ = R(t, x-), and the mode changes. Everything in `forward/` and `adjoint/` is written against this page alone.
"""

import abc
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from .status import Status

Mode = PyTree[Array]
"""The discrete state: any PyTree of arrays of fixed shape. It is never differentiated."""


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
    hop: Float[Array, ""] | float = float("inf")
    """How soon a guard that is being left may fall again: the first step after the event is no longer than that."""


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


class AbstractHybridSystem(eqx.Module):
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
        """The discrete part of a transition: next mode and which law acts. Never differentiated."""

    def choose(self, event: Int[Array, ""], t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Decision:
        """`decide`, and where `event` is -1 the mode in which a motion from (t, x) begins: by default the given one."""
        begins = event < 0
        decision = self.decide(jnp.maximum(event, 0), t, x, mode)
        return Decision(
            jax.tree.map(lambda old, new: jnp.where(begins, old, new), mode, decision.mode),
            decision.kind,
            decision.detail,
            jnp.where(begins, False, decision.grazing),
            Status.where(begins, Status.running, decision.status),
            jnp.where(begins, jnp.inf, decision.hop),
        )

    @abc.abstractmethod
    def reset(
        self, decision: Decision, t: Float[Array, ""], x: Float[Array, "state"]
    ) -> tuple[Float[Array, "state"], PyTree[Array]]:
        """The smooth part: the state just after, R(t, x-), and what the event emits (an impulse, say)."""

    def project(self, t: Float[Array, ""], x: Float[Array, "state"], mode: Mode) -> Float[Array, "state"]:
        """Put a state that drifted by rounding and truncation back on its mode's constraints; by default nothing."""
        del t, mode
        return x

    def unconstrained(self, mode: Mode) -> "tuple[Bool[Array, ''], AbstractHybridSystem] | None":
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

    def grazing_depth(self, mode: Mode) -> Float[Array, "guard"] | float:
        """A minimum of a guard that stays above zero by less than this cannot be told from an event."""
        del mode
        return -1.0
