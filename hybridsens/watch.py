"""Which guards can fall: some wait until they have risen, some fire at once.

A guard that the motion passes through, or that is below zero at the start, is watched with its sign turned until it
rises; its rise is an event too, a silent one. A guard that a transition puts below zero fires at once.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from .numerics.tolerances import MOST_RELAXED, closeness, jump_window, rounding, time_resolution

Guards = Callable[[Array, Array, Any], Array]
"""(t, x, mode) -> guards of the system as the user wrote them."""

AlongMotion = Callable[[Array, Array], Array]
"""(t, x) -> guards, or the flow, of one mode."""

UNEVEN = 0.618
"""Multiples of it, less their whole part, are no two alike for long."""


class WatchedMode(eqx.Module):
    """The mode of a system, with what the search for events knows of its guards."""

    given: Any
    """The mode that the user's system speaks of."""
    watch: "Watch"
    """Which guards can fall."""
    expected: Bool[Array, "time"]
    """Scheduled times that are still to come."""
    next_time: Float[Array, ""] | None
    """The first of them, as the last event showed it; inf where none is to come, None without scheduled times."""


class Seen(eqx.Module):
    """Guards at one instant, and their rates along the flow."""

    value: Float[Array, "guard"]
    rate: Float[Array, "guard"]
    scale: Float[Array, "guard"]
    """By how much each would change if t and x changed by as much as they are: what its rounding is relative to."""
    present: Float[Array, "guard"]
    """The same, if all of x changed by as much as its largest entry is now."""
    reach: Float[Array, "state"]
    """Largest |x| so far."""


class Watch(eqx.Module):
    """What the search for events knows of each guard. Nothing here is ever differentiated."""

    armed: Bool[Array, "guard"]
    """Guards that can fall. The others are below zero, and are watched for when they rise again."""
    pending: Bool[Array, "guard"]
    """Guards that a transition has put below zero: they fire at once."""
    size: Float[Array, "guard"]
    """Largest value of each guard that events have shown."""
    speed: Float[Array, "guard"]
    """The same of its rate."""
    reach: Float[Array, "state"]
    """Largest |x| that events have shown."""
    margin: Float[Array, "guard"]
    """What is granted to a guard that an event left below zero by an error of the state; see `lift_off`."""

    @classmethod
    def blank(cls, count: int, x: Float[Array, "state"]) -> "Watch":
        """What is known of guards before anything is."""
        no, zero = jnp.zeros(count, bool), jnp.zeros(count, x.dtype)
        return cls(no, no, zero, zero, jnp.zeros_like(x), zero)

    def see(self, guards: Callable[[Array, Array], Array], t, x, flow) -> Seen:
        """Guards, as the user wrote them, of (t, x), and their rates along a flow."""
        value, change = jax.linearize(guards, t, x)
        reach = jnp.maximum(self.reach, jnp.abs(x))
        now = jnp.full_like(x, jnp.max(jnp.abs(x), initial=0.0))
        scale, present = (jnp.abs(change(t, _uneven(size))) for size in (reach, now))
        return Seen(value, change(jnp.ones_like(t), flow), scale, present, reach)

    def scales(self, guards: Callable[[Array, Array], Array], t, x) -> tuple[Array, Array]:
        """What rounding of the guards and of their rates is relative to at (t, x).

        A guard may be large far from its zero and steep there, as an exponential is: its rounding at zero is not that
        of its largest value."""
        share = self._share(jnp.abs(self._moved(guards, t, x)(t, x)))
        return share * self.size, share * self.speed

    def turning_scales(self, guards: Callable[[Array, Array], Array], t, x) -> tuple[Array, Array]:
        """The same, of guards that turn at (t, x): flat to first order, they are differences of numbers as large as
        their second derivative tells."""
        moved = self._moved(guards, t, x)
        slope, bend = jax.jvp(moved, (t, x), (t, _uneven(jnp.maximum(self.reach, jnp.abs(x)))))
        share = self._share(jnp.maximum(jnp.abs(slope), jnp.abs(bend) / 2))
        return share * self.size, share * self.speed

    def _moved(self, guards: Callable[[Array, Array], Array], t, x) -> Callable[[Array, Array], Array]:
        """By how much guards would change, to first order, if t and x changed by as much as they are here."""
        by = t, _uneven(jnp.maximum(self.reach, jnp.abs(x)))
        return lambda t, x: jax.jvp(guards, (t, x), by)[1]

    def signed(self, guards: Float[Array, "guard"]) -> Float[Array, "guard"]:
        """The guards, those that wait for their rise with the sign turned."""
        return jnp.where(self.armed, guards + self.margin, -guards)

    def rates(self, signed: Float[Array, "guard"]) -> Float[Array, "guard"]:
        """Rates of the signed guards; whatever its own rate, a pending guard falls."""
        at_once = -jnp.maximum(jnp.abs(signed), self.speed) - 1
        return jnp.where(self.pending, at_once, signed)

    def is_silent(self, event: Int[Array, ""]) -> Bool[Array, ""]:
        """Whether guard `event` has risen rather than fallen."""
        return jnp.any((jnp.arange(self.armed.size) == event) & ~self.armed)

    def fires_at_once(self, event: Int[Array, ""]) -> Bool[Array, ""]:
        """Whether guard `event` was put below zero by the event before."""
        return jnp.any((jnp.arange(self.armed.size) == event) & self.pending)

    def begin(self, t, seen: Seen, starts: Bool[Array, ""]) -> "Watch":
        """At the start a guard that is below zero waits for its rise; one that a jump time puts there fires."""
        # One that starts on zero does not show its size there; what it is a difference of does.
        rounded = rounding(seen.value.dtype)
        on_zero = starts & jnp.isfinite(seen.scale) & (jnp.abs(seen.value) <= rounded * seen.scale)
        known = dataclasses.replace(self, size=jnp.where(on_zero, jnp.maximum(self.size, seen.scale), self.size))
        value = seen.value + self.margin
        above = value >= -rounded * known.size - time_resolution(t, 1) * jnp.abs(seen.rate)
        armed = jnp.where(starts, above, self.armed)
        # One that was falling by itself may have passed zero while the clock passed the jump time.
        speed = jnp.maximum(self.speed, jnp.abs(seen.rate))
        by_itself = (seen.rate < 0) & (value >= -jump_window(t) * speed)
        return known._widened(armed, ~starts & armed & (value < 0) & ~by_itself, seen)

    def after(
        self, event: Int[Array, ""], t, before: Seen, same: Bool[Array, "guard"], seen: Seen, lift
    ) -> tuple["Watch", Bool[Array, ""]]:
        """After an event (of a guard, or of any other number) at t, given the guards just before it, which of them mean
        the same after it (`compare`), what is seen of them then, and what is granted to those that lift off zero
        (`lift_off`); and whether it is unclear if the event moved its guard, or rounding of sizes that are long gone
        did."""
        near = closeness(before.value.dtype)
        share = self._share(before.scale)
        this, guards = jnp.arange(self.armed.size) == event, seen.value
        misplaced = _misplaced(this, t, before)
        # An event is placed to what time can resolve: by so much its guard may be off, and be put back.
        told_apart = near * share * self.size + time_resolution(t, 1) * jnp.abs(before.rate)
        still = jnp.abs(guards - before.value) <= told_apart
        # One that has jumped below zero need not fall any more.
        below = guards < -told_apart
        falls_on = (seen.rate < -near * share * self.speed) | (self.pending & (guards < 0)) | below
        passing = this & self.armed & same & still & falls_on
        # By the sizes of now it has risen: neither is certain then, and to take it for passed might lose an event.
        risen = guards - before.value > near * before.present + misplaced * jnp.abs(before.rate)
        unclear = this & self.armed & same & still & risen & (seen.rate < 0)
        # One that was passed at this very instant is on zero still: another event does not make it fall again.
        waiting = ~this & ~self.armed & ((guards < 0) | (same & still))
        armed = ~passing & ~waiting
        # A guard that is on zero and falling by itself fires too, but at a time of its own; one that begins to rise at
        # this event is below zero by where that was placed.
        rises = (seen.rate > 0) & (guards >= -misplaced * seen.rate)
        lifts = (lift > 0) & ~still
        pending = armed & (guards < 0) & ~rises & ~lifts & (~still | (self.pending & ~this))
        margin = jnp.where(lifts, lift, jnp.where(same & ~this, self.margin, 0))
        return dataclasses.replace(self._widened(armed, pending, seen), margin=margin), jnp.any(unclear)

    def compare(self, guards: Guards, modes: tuple[Any, Any], t, x, flow) -> tuple[Seen, Bool[Array, "guard"]]:
        """Guards before an event, and which of them mean the same in the mode after: they have the value and the slope
        (along the flow before) that they had. One that was turned round (a threshold without hysteresis) has another
        slope."""
        old, new = modes
        look = lambda mode: self.see(lambda t, x: guards(t, x, mode), t, x, flow)
        before = look(old)
        there = lax.cond(same_mode(new, old), lambda: before, lambda: look(new))
        share = closeness(x.dtype) * self._share(before.scale)
        same_value = jnp.abs(there.value - before.value) <= share * self.size
        return before, same_value & (jnp.abs(there.rate - before.rate) <= share * self.speed)

    def lift_off(self, guards: AlongMotion, flow: AlongMotion, place, seen: Seen, depth) -> Float[Array, "guard"]:
        """What is granted to guards that an event has left on a zero that they lift off: 0 for all others.

        A motion that slid along a surface leaves it without a rate, by its acceleration alone, and from one side or the
        other, as errors of the state have it. `depth` is the (relative, absolute) error of a state that is allowed: a
        guard that is off by no more than that makes, and turns within it, has not been put below zero."""
        t, x = place
        relative, absolute = depth
        # Relative to the state of now: one that once was far larger tells nothing of where this guard was put.
        _, off = jax.jvp(lambda x: guards(t, x), (x,), (_uneven(relative * jnp.abs(x) + absolute),))
        rounded = 2 * rounding(x.dtype) * jnp.maximum(self.size, seen.scale)
        resolved = 10 * jnp.abs(off) + rounded  # errors of many steps along the surface add up
        on_zero = jnp.abs(seen.value) < resolved

        def lifting():
            along = lambda function: lambda t, x: jax.jvp(function, (t, x), (jnp.ones_like(t), flow(t, x)))[1]
            bend = along(along(guards))(t, x)
            dip = seen.rate**2 / jnp.where(bend > 0, bend, 1)  # twice as deep as it gets
            lifts = on_zero & (bend > 0) & (dip < resolved)
            return jnp.where(lifts, jnp.maximum(dip + rounded - seen.value, 0), 0)

        return lax.cond(jnp.any(on_zero), lifting, lambda: jnp.zeros_like(seen.value))

    def _share(self, scale) -> Float[Array, "guard"]:
        """What part of their sizes so far the rounding of guards of that scale is relative to: all, unless they are far
        flatter there."""
        flatter = scale < self.size  # not where the scale is no number
        return jnp.where(flatter, scale / jnp.where(flatter, self.size, 1), 1)

    def _widened(self, armed, pending, seen: Seen) -> "Watch":
        size, speed = _largest(self.size, seen.value), _largest(self.speed, seen.rate)
        return Watch(armed, pending, size, speed, seen.reach, self.margin)


def _misplaced(fallen: Bool[Array, "guard"], t, before: Seen) -> Float[Array, ""]:
    """By how much time an event may be off: by what its guard lacks to zero, at most by what event location grants.
    Of what is no guard of these, as an impact, that is not known: it counts as relaxed twice, as for contacts that
    meet."""
    lacks = jnp.where(fallen, jnp.abs(before.value) / jnp.where(before.rate != 0, jnp.abs(before.rate), 1), 0)
    placed = time_resolution(t, 2) + jnp.max(lacks, initial=0.0)
    return jnp.minimum(placed, time_resolution(t, MOST_RELAXED))


def _largest(so_far: Float[Array, "guard"], now: Float[Array, "guard"]) -> Float[Array, "guard"]:
    """The largest size so far. An infinite one, as of a logarithm of 0, tells nothing of any rounding."""
    return jnp.maximum(so_far, jnp.where(jnp.isfinite(now), jnp.abs(now), 0))


def _uneven(reach: Float[Array, "state"]) -> Float[Array, "state"]:
    """Uneven parts of each entry, so that equal terms of different signs do not cancel."""
    return reach * (1 + jnp.arange(reach.shape[0], dtype=reach.dtype) * UNEVEN % 1)


def same_mode(one, other) -> Bool[Array, ""]:
    """Whether two modes have equal entries."""
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return jnp.all(jnp.stack([jnp.array(True), *(jnp.all(a == b) for a, b in pairs)]))
