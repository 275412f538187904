"""Any hybrid system: what a user writes to have its motion and its gradient."""

import abc
from typing import Any, ClassVar

from jaxtyping import Array, Float, Int, PyTree

from .model import Model

Mode = PyTree[Array]
"""The discrete state: any PyTree of arrays of fixed shape. It is never differentiated."""


class AbstractHybridSystem(Model):
    """x' = flow(t, x, mode) until a guard falls through 0; then (x, mode) = transition(event, t, x, mode).

    Write these three methods; `scheduled_times` and `jump_times` where times are known. A ball that counts its bounces:

        class Ball(hybridsens.AbstractHybridSystem):
            g: jax.Array                               # array fields are the parameters
            e: jax.Array
            def flow(self, t, x, mode):                # x: any PyTree of real arrays; its rate is of x's structure
                return {"height": x["speed"], "speed": -self.g}
            def guards(self, t, x, mode):              # one vector, smooth in t and x
                return x["height"][None]
            def transition(self, event, t, x, mode):   # mode: any PyTree of arrays; None where there is only one
                return {"height": x["height"], "speed": -self.e * x["speed"]}, mode + 1

        ball = Ball(jnp.array(9.81), jnp.array(0.8))
        solution = hybridsens.solve(ball, {"height": 1.0, "speed": 0.0}, 0, t1=1.0)

    A number, or a list of numbers, given for a field that is declared as an array is made one; fields declared as
    `float` or `int` are constants, whose gradient is None.

    All is plain JAX, with `jnp.where` and `jax.lax.switch` in place of `if`. An event happens where a guard falls from
    above 0 to 0:

    - A guard that the motion passes through, because the transition changes neither its value nor its meaning, must
      rise above 0 before it can fall again (a section that is only recorded). So must one that starts below 0.
    - A guard that a transition puts below 0 fires at once, also the one whose event it was: a reset that subtracts.
    - Where several guards fall at once they fire one after the other, each only if it still is at 0 and falling.
    """

    known_discontinuities: ClassVar[bool] = False
    """Whether kinks and jumps of `flow` and `guards` are known to do no harm: then no warning is given."""

    located_discontinuities: ClassVar[bool] = False
    """Whether comparisons are events: `jnp.where(x > 0, ...)`, `jnp.abs`, `jnp.maximum`, `jnp.minimum`, `jnp.clip`,
    `jnp.sign`, `relu`, `jnp.floor`, `jnp.round`, `%`, `jnp.argmax` of t and x in `flow`, `guards` and running costs.
    Then each keeps its outcome until what it compares is equal, a step ends there, and values and gradients are as
    exact as for a mode of your own. These events are listed by numbers behind those of guards and scheduled times, and
    take part in `max_events`. Left alone are tables, sorting, comparisons of integers and those in loops and branches
    of `jax.lax.cond`."""

    event_names: ClassVar[tuple[str, ...] | None] = None
    """Names of the events for tables, messages and pictures, one for each guard and then for each scheduled time; a
    property where their number is known later. None, the default, for numbers."""

    @abc.abstractmethod
    def flow(self, t: Float[Array, ""], x: Any, mode: Any) -> Any:
        """Time derivative of the state in a mode, of the structure and shapes of x."""

    @abc.abstractmethod
    def guards(self, t: Float[Array, ""], x: Any, mode: Any) -> Float[Array, "guard"]:
        """Event functions of a mode, of shape (guard,): positive inside, an event where one falls to 0."""

    @abc.abstractmethod
    def transition(self, event: Int[Array, ""], t: Float[Array, ""], x: Any, mode: Any) -> tuple[Any, Any]:
        """State and mode after an event, of the structure, shapes and types of those before.

        `event` is the index of the guard that fell, or the number of guards plus the index of the scheduled time that
        came: choose by `jnp.where` or `jax.lax.switch`."""

    def scheduled_times(self, x: Any, mode: Any) -> Float[Array, "time"] | None:
        """Times of events that are known before they come: doses, input spikes, ticks of a clock, ends of delays.

        A step ends on each of them, and nothing is searched for. They are made from parameters, from the mode, and from
        parts of the state whose flow is 0 (the end of a delay that an earlier event has written there); gradients reach
        them on each of these ways. A time comes once, also where it is t0 or t1. Where an event moves it, it
        comes again: at once if it has passed. One that stays the same number has come: two ticks of a clock at one
        instant are two entries, or one event. Times before t0 never come. None, the default, or an empty array for
        none."""
        del x, mode
        return None

    def jump_times(self) -> Float[Array, "jump"] | None:
        """Times at which the flow has a kink or a jump (knots of a control, say): steps end there, and gradients reach
        them. None, the default, for none."""
        return None
