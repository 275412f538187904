"""A hybrid system as the solver sees it: one vector for the state and the integrals of the running cost."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from .flat_system import START, AbstractFlatSystem, Decision, Searched, StepEnds
from .interval.kind import Kind
from .located.system import asked_for_cost, own_mode, own_number
from .numerics.fixed import number
from .numerics.shapes import Shapes
from .numerics.tolerances import closeness, jump_window
from .observables import EventMarks, EventStates
from .search.gap_search import gap_kinds, search_guards, warn_of_sampled
from .solution import SolutionEvents
from .status import Status
from .system import AbstractHybridSystem
from .system_checks import as_written
from .system_decision import EventDetail, Shown, decision_of
from .until import ends_with
from .watch import Seen, Watch, WatchedMode


class FlattenedSystem(AbstractFlatSystem):
    """x in one vector, followed by z with z' = running cost. A guard that is not armed is watched with its sign
    turned, so that its rise is an event too, a silent one."""

    system: AbstractHybridSystem
    running_cost: Callable[..., Any] | None
    """running_cost(system, t, x, mode): a scalar or a PyTree; None where there is none."""
    jump_ts: Float[Array, "jump"] | None
    shapes: Shapes = eqx.field(static=True)
    guard_count: int = eqx.field(static=True)
    scheduled_count: int | None = eqx.field(static=True)
    """How many scheduled times there are; None where the system does not speak of any."""
    first_mode: Any
    """The mode in which the motion begins."""
    until: Callable[..., Any] | None = None
    """until(system, event): whether the motion ends with an event; None where it goes on to t1."""
    depth: tuple[Any, Any] = (0.0, 0.0)
    """(relative, absolute) error of a state that the tolerances allow."""
    program: str = eqx.field(default="", static=True)
    """What its functions compute: where they read from elsewhere, two systems of one class may differ in that alone."""

    def split(self, vector):
        """x and z of a flat state (leading axes are kept)."""
        return self.shapes.restore(vector[..., : self.shapes.size]), vector[..., self.shapes.size :]

    def flow(self, t, x, mode: WatchedMode):
        given, _ = self.split(x)
        parts = [self.shapes.flatten(self.system.flow(t, given, mode.given), x.dtype)]
        parts += [jnp.ravel(leaf).astype(x.dtype) for leaf in jax.tree.leaves(self.cost_rate(t, given, mode.given))]
        return jnp.concatenate(parts)

    def cost_rate(self, t, x, mode):
        """Running cost at one instant, with its structure; None where there is none."""
        return None if self.running_cost is None else self.running_cost(asked_for_cost(self.system), t, x, mode)

    def guards(self, t, x, mode: WatchedMode):
        return mode.watch.signed(self._values(t, x, mode.given))

    def guards_and_rates(self, t, x, mode: WatchedMode):
        guards, rates = super().guards_and_rates(t, x, mode)
        return guards, mode.watch.rates(rates)

    def _values(self, t, x, given):
        return self.system.guards(t, self.split(x)[0], given).astype(x.dtype)

    def scales(self, t, x, mode: WatchedMode):
        """Those that events have shown, or less where a guard is flatter."""
        return mode.watch.scales(lambda t, x: self._values(t, x, mode.given), t, x)

    def turning_scales(self, t, x, mode: WatchedMode):
        """Those that events have shown, or less where a guard is flatter to second order too."""
        return mode.watch.turning_scales(lambda t, x: self._values(t, x, mode.given), t, x)

    def warn_of_sampled(self, t, x):
        """Say which guards are only sampled inside a step."""
        warn_of_sampled("Guards", lambda t, x: self._values(t, x, self.first_mode), t, x)

    def searches(self, t, x):
        """Whether a guard is curved: what is affine in (t, x) cannot dip unseen. Told from the trace of the guards."""
        return bool((gap_kinds(lambda t, x: self._values(t, x, self.first_mode), t, x)[0] >= Kind.CURVED).any())

    def search(self, step: StepEnds, mode: WatchedMode, tolerance, wanted) -> Searched:
        """Guards along the cubic through the ends of the step, and within what it may be off."""
        flow, guards = (lambda t, x: self.flow(t, x, mode)), (lambda t, x: self.guards(t, x, mode))
        return search_guards(guards, flow, step, mode.watch.speed, tolerance, wanted)

    def decide(self, event, t, x, mode: WatchedMode) -> Decision:
        """At the start a guard that is below zero waits for its rise; one that a jump time puts there fires."""

        def begin():
            shown = self._show(t, x, mode)
            starts = event == START
            watch = mode.watch.begin(t, shown.guards, starts)
            expected = jnp.where(starts, shown.times >= t, mode.expected)
            moves = ~starts & self._moves_by_itself(t, x, mode)
            watched = WatchedMode(mode.given, watch, expected, self._next_time(shown.times, expected))
            return decision_of(watched, EventDetail(event, mode.given), shown, moves)

        return lax.cond(event >= 0, lambda: self._after(event, t, x, mode), begin)

    def _show(self, t, x, mode: WatchedMode) -> Shown:
        """Guards and scheduled times, and their rates along the flow of the mode."""
        flow = self.flow(t, x, mode)
        guards = mode.watch.see(lambda t, x: self._values(t, x, mode.given), t, x, flow)
        return Shown(guards, *jax.jvp(lambda x: self._times(x, mode.given), (x,), (flow,)))

    def _times(self, x, given):
        """Scheduled times, none where the system does not speak of any."""
        if self.scheduled_count is None:
            return jnp.zeros(0, x.dtype)
        return jnp.asarray(self.system.scheduled_times(self.split(x)[0], given)).astype(x.dtype)

    def _next_time(self, times, expected):
        """The first of the times that are expected; None where the system does not speak of any."""
        return None if self.scheduled_count is None else _first(times, expected)

    def _moves_by_itself(self, t, x, mode: WatchedMode):
        """Whether the next scheduled time has moved since the last event, by more than rounding. Its rate may be zero
        at both."""
        if mode.next_time is None:
            return jnp.array(False)
        now, near = _first(self._times(x, mode.given), mode.expected), closeness(x.dtype)
        return ~jnp.isclose(now, mode.next_time, rtol=near, atol=near * jnp.abs(t), equal_nan=True)

    def status_at_end(self, t, x, mode: WatchedMode, status: Status) -> Status:
        """The status of a motion that ended at (t, x): of a whole one also whether a scheduled time has moved."""
        if mode.next_time is None:
            return status
        moves = status.reached_end & self._moves_by_itself(t, lax.stop_gradient(x), mode)
        return Status.where(moves, Status.scheduled_time_moves, status)

    def scheduled_times(self, x, mode: WatchedMode):
        """Those of the system in a mode."""
        return None if self.scheduled_count is None else self._times(x, mode.given)

    def expected(self, mode: WatchedMode):
        """Those that have not come, or were moved since."""
        return mode.expected

    def watched_mode(self, mode, x) -> WatchedMode:
        """The mode that a motion begins in; `decide` looks at its guards."""
        never = None if self.scheduled_count is None else jnp.full((), jnp.inf, x.dtype)
        expected = jnp.zeros(self.scheduled_count or 0, bool)
        return WatchedMode(mode, Watch.blank(self.guard_count, x), expected, never)

    def _after(self, event, t, x, mode: WatchedMode) -> Decision:
        """The transition's mode, which guards can fall then, and which scheduled times are to come."""
        detail = EventDetail(event, mode.given)
        if self.guard_count == 0 and self.scheduled_count is None:
            return decision_of(mode, detail, self._show(t, x, mode), jnp.array(False))
        rises = self.is_silent(event, mode)  # then the state and the user's mode stay
        after, given = self._transition(event, t, x, mode.given)
        given = jax.tree.map(lambda new, old: jnp.where(rises, old, new), given, mode.given)
        after = jnp.where(rises, x, after)
        flow = self.flow(t, x, mode)
        before, same = mode.watch.compare(self._values, (mode.given, given), t, x, flow)
        shown = self._show(t, after, dataclasses.replace(mode, given=given))
        lift = self._lift(t, after, dataclasses.replace(mode, given=given), shown.guards)
        watch, unclear = mode.watch.after(event, t, before, same, shown.guards, lift)
        came, times = self.guard_count + jnp.arange(shown.times.shape[0]) == event, self._times(x, mode.given)
        moved = shown.times != times  # to a time that has passed: then the event comes at once
        expected = (mode.expected & ~came) | (shown.times > t) | moved
        watched = WatchedMode(given, watch, expected, self._next_time(shown.times, expected))
        # A time that falls together with a jump time has passed when the clock stands behind it: nothing has moved it.
        at_once = self.fires_at_once(event, mode) | jnp.any(came & (times < t - jump_window(t)))
        decision = decision_of(watched, detail, shown, self._moves_by_itself(t, x, mode), at_once, rises)
        return dataclasses.replace(decision, status=Status.where(unclear, Status.reset_unclear, decision.status))

    def _lift(self, t, x, mode: WatchedMode, seen: Seen):
        """What is granted to guards that an event leaves on a zero that they lift off."""
        guards, flow = (lambda t, x: self._values(t, x, mode.given)), (lambda t, x: self.flow(t, x, mode))
        return mode.watch.lift_off(guards, flow, (t, x), seen, tuple(map(number, self.depth)))

    def _transition(self, event, t, x, given):
        state, z = self.split(x)
        after, given = self.system.transition(event, t, state, given)
        given = jax.tree.map(lax.stop_gradient, given)
        return jnp.concatenate([self.shapes.flatten(after, x.dtype), z]), given

    def reset(self, decision: Decision, t, x):
        """x+ of the user's transition, z unchanged."""
        detail: EventDetail = decision.detail
        after, _ = self._transition(detail.event, t, x, detail.mode)
        return lax.cond(decision.silent, lambda: x, lambda: after), ()

    def silent_room(self, max_events):
        """A guard waits after it was passed, or from the start."""
        return max_events + self.guard_count

    def is_silent(self, event, mode: WatchedMode):
        return mode.watch.is_silent(event)

    def fires_at_once(self, event, mode: WatchedMode):
        return mode.watch.fires_at_once(event)

    def jump_times(self):
        """Those declared, by the caller or by the system."""
        return self.jump_ts

    def events(self, states: EventStates, marks: EventMarks) -> SolutionEvents:
        """Events as they are reported: one, or a row for each."""
        which = own_number(marks.number, self.system, self.guard_count, self.scheduled_count or 0)
        before, after = (self.split(side)[0] for side in (states.before, states.after))
        return SolutionEvents(states.time, which, before, after, own_mode(marks.mode.given), marks.count)

    def ends_with(self, states, marks):
        return ends_with(self.until, as_written(self.system), lambda: self.events(states, marks))


def _first(times, expected) -> Array:
    """The first of the times that are expected; inf where there is none."""
    return jnp.min(times, initial=jnp.inf, where=expected)
