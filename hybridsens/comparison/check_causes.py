"""Why a gradient is in doubt, and what to do about it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..discontinuities import REMEDIES as OF_SYSTEMS
from ..discontinuities import remedies_for
from ..mechanics.events import Events
from ..mechanics.scene import AbstractScene
from ..mechanics.smoothness import REMEDIES
from ..status import Status
from .check_events import OTHER_EVENTS, EventCheck
from .check_finite import without_derivative
from .check_grazing import grazes
from .check_motions import Call
from .check_report import KINK, ONE_SIDED, UNDECIDED, Cause, Doubts, ParameterCheck

NEAR = 1e-6
"""An event this part of the horizon away from a time asked for happens at that time."""


def find_causes(
    parameters: Sequence[ParameterCheck],
    events: Sequence[EventCheck],
    calls: Sequence[Call],
    resolved: dict[str, bool],
    settings: dict[str, Any],
) -> tuple[Cause, ...]:
    """Likely causes of all doubts; none where all agree.

    `resolved` has the parameters that are off the reference, and whether the steps resolve the derivative there.
    """
    # Where a guard or the flow jumps there is no derivative that shorter steps would bring.
    jumps = any(call.status == Status.guard_jumps or call.status == Status.flow_jumps for call in calls)
    is_nan = any(np.isnan((entry.adjoint, entry.forward)).any() for entry in parameters if entry.verdict)
    if is_nan and not jumps:
        found = [_no_derivative(parameters, events, n, call) for n, call in enumerate(calls)]
        if causes := tuple(cause for cause in found if cause is not None):
            return causes
    steps = () if jumps else tuple(name for name, ok in resolved.items() if not ok)
    doubts = Doubts(
        tuple(entry.parameter for entry in parameters if entry.verdict and entry.parameter not in steps),
        tuple(entry for entry in events if entry.verdict),
    )
    causes = [_step_control(steps)] if steps else []
    if any(doubts):
        others = [cause for n, call in enumerate(calls) for cause in _of_motion(doubts, n, call, settings)]
        doubted = [entry.verdict for entry in parameters if entry.verdict]
        if not others and doubted and all(verdict.startswith(KINK) for verdict in doubted):
            others = [_kink(doubts)]
        if not others and doubted and all(verdict.startswith(ONE_SIDED) for verdict in doubted):
            others = [_one_sided(doubts)]
        causes += others or _elsewhere(doubts, resolved, all(verdict.startswith(UNDECIDED) for verdict in doubted))
    return tuple(causes)


def _no_derivative(parameters: Sequence[ParameterCheck], events: Sequence[EventCheck], n: int, call: Call):
    """The cause of a nan, where a function of the motion has no finite derivative."""
    found = without_derivative(call)
    if not found:
        return None
    names = tuple(entry.parameter for entry in parameters if entry.verdict)
    labels = tuple(entry.label for entry in events if entry.verdict and entry.motion == n)
    told = ", ".join(f"`{name}` at t = {time:.6g}" for name, time in found.items())
    reason = f"a function whose derivative is not finite where the motion comes: {told}"
    remedy = (
        "make it finite there; `jnp.linalg.norm(v)` and `jnp.sqrt(v @ v)` have none at v = 0, "
        "`jnp.sqrt(v @ v + 1e-30)` has"
    )
    return Cause("no derivative", names, labels, reason, remedy)


def _step_control(names: tuple[str, ...]) -> Cause:
    reason = "the steps do not resolve the derivative: with shorter ones it is another"
    remedy = (
        "leave the error control of the derivative on (`rtol` of the gradient method), or tighten it; where a gradient "
        "is nan, its steps did not suffice: raise `max_steps`"
    )
    return Cause("step control", names, (), reason, remedy)


def _elsewhere(doubts: Doubts, resolved: dict[str, bool], undecided: bool) -> list[Cause]:
    """Causes where no motion shows one: it is not resolved, or the derivative is that of another function."""
    off = tuple(name for name in doubts.parameters if name in resolved)
    rest = doubts._replace(parameters=tuple(name for name in doubts.parameters if name not in off))
    reason = "the motion is not resolved: with another solver and tighter tolerances the gradient is another"
    motion = Cause("motion", off, (), reason, "tighten `rtol` and `atol`, or shorten the horizon")
    untested = not doubts.parameters and not resolved and all(entry.verdict == OTHER_EVENTS for entry in doubts.events)
    other = _untested(rest) if untested else _unexplained(rest, undecided and not doubts.events)
    return ([motion] if off else []) + ([other] if any(rest) else [])


def _of_motion(doubts: Doubts, number: int, call: Call, settings) -> list[Cause]:
    here = doubts._replace(events=tuple(entry for entry in doubts.events if entry.motion == number))
    if not any(here):
        return []
    found = [_discontinuity(here, call), _at_data_time(here, number, call), _at_jump_time(here, number, call)]
    if isinstance(call.events, Events):  # of contacts more is known
        found += [_simultaneous(here, number, call), _grazing(here, number, call, settings)]
    return [cause for cause in found if cause is not None]


def _discontinuity(doubts: Doubts, call: Call) -> Cause | None:
    if call.status == Status.guard_jumps:
        reason = "an event comes where its guard jumps below zero, and nothing tells how that place moves"
        return doubts.cause("discontinuity", reason, "write an event that falls at that place", doubts.events)
    if not call.breaks and call.status == Status.flow_jumps:
        reason = f"the flow jumps, or changes within less than a step, at t = {float(call.doubt_time):.6g}"
        remedy = "make that an event, by a guard or by `located_discontinuities = True`, or widen what is steep"
        return doubts.cause("discontinuity", reason, remedy, doubts.events)
    if not call.breaks:
        return None
    names = {b.function: [] for b in call.breaks}
    for b in call.breaks:
        names[b.function].append(f"{b.operation} of {' and '.join(b.inputs)}")
    told = "; ".join(f"`{name}` has {', '.join(those)}" for name, those in names.items())
    reason = f"a kink or a jump that no event or declared time tells of: {told}"
    remedy = _remedy(call).rstrip(".")
    return doubts.cause("discontinuity", reason, remedy[0].lower() + remedy[1:], doubts.events)


def _remedy(call: Call) -> str:
    """What to do about the breaks of a motion."""
    moved = {b.function: "" for b in call.breaks}
    for b in call.breaks:
        moved[b.function] += b.inputs
    return " ".join(remedies_for(moved, REMEDIES if isinstance(call.scene, AbstractScene) else OF_SYSTEMS))


def _simultaneous(doubts: Doubts, number: int, call: Call) -> Cause | None:
    rows = np.flatnonzero(np.asarray(call.events.order_matters)).tolist()
    if not rows:
        return None
    reason = (
        f"impacts of several contacts at one instant ({_labels(number, rows)}), whose order decides the outcome: "
        "there is no derivative, only one-sided ones"
    )
    remedy = "move the parameters or the initial state off this corner, or leave this motion out"
    return doubts.cause("simultaneous impacts", reason, remedy, _those_with(doubts, rows))


def _at_data_time(doubts: Doubts, number: int, call: Call) -> Cause | None:
    """A state asked for at the instant of an impact jumps from one side to the other when a parameter moves."""
    asked = [call.t0, call.t1, *([] if call.ts is None else np.asarray(call.ts))]
    met = _events_at(doubts, number, call, asked)
    if met is None:
        return None
    reason = (
        f"an event ({met[0]}) at a time at which the state is asked for or the horizon ends (t = {met[1]}): what is "
        "asked for is before it or after it, for the least change"
    )
    return doubts.cause("event at a data time", reason, "move that time off the event, or leave that sample out")


def _at_jump_time(doubts: Doubts, number: int, call: Call) -> Cause | None:
    """An event at a declared jump time comes before it or after it when a parameter moves, with another derivative; and
    such a time at an end of the horizon comes to lie inside of it or outside."""
    declared = call.scene.jump_times() if call.jump_ts is None else call.jump_ts
    if declared is None or not doubts.parameters:
        return None
    met = _events_at(doubts, number, call, declared)
    if met is not None:
        reason = (
            f"an event ({met[0]}) at a declared jump time (t = {met[1]}): for the least change it comes before that "
            "time or after it, so that a derivative holds on one side alone"
        )
        remedy = "move that time off the event, or take one-sided differences"
        return doubts.cause("event at a jump time", reason, remedy)
    near = NEAR * float(call.t1 - call.t0)
    ends = [float(end) for end in (call.t0, call.t1) if np.any(np.abs(np.asarray(declared) - float(end)) <= near)]
    if not ends:
        return None
    reason = (
        f"a declared jump time at an end of the horizon (t = {', '.join(f'{end:.6g}' for end in ends)}): for the least "
        "change it lies inside or outside, so that a derivative by it holds on one side alone"
    )
    return doubts.cause("jump time at an end", reason, "leave that parameter out, or move that time off the end")


def _events_at(doubts: Doubts, number: int, call: Call, asked) -> tuple[str, str] | None:
    """Events at some of the times asked for, and these times, in words; None where there are none."""
    asked, times = np.asarray(asked), np.asarray(call.events.time)[: int(call.events.count)]
    distance = np.abs(times[:, None] - asked)
    rows, columns = np.nonzero(distance <= NEAR * float(call.t1 - call.t0))
    if not doubts.parameters or rows.size == 0:
        return None
    instants = ", ".join(f"{t:.6g}" for t in sorted(set(asked[columns].tolist())))
    return _labels(number, sorted(set(rows.tolist()))), instants


def _grazing(doubts: Doubts, number: int, call: Call, settings) -> Cause | None:
    found = grazes(call, settings)
    if not found and call.status != Status.grazing:
        return None
    rows = [graze.event for graze in found if graze.event is not None]
    strikes = [f"event {number}:{g.event} closes at {g.speed:.1e} of the fastest" for g in found if g.event is not None]
    misses = [f"contact {g.contact} is missed narrowly near t = {g.time:.6g}" for g in found if g.event is None]
    told = "; ".join(strikes + misses) or "the motion has status `grazing`"
    reason = f"near grazing: {told}. Sensitivities grow like 1 / closing speed, and the event comes and goes"
    remedy = "move the parameters away from grazing, or trust the gradient only for changes smaller than its distance"
    return doubts.cause("grazing", reason, remedy, _those_with(doubts, rows))


def _one_sided(doubts: Doubts) -> Cause:
    reason = (
        "from this very point on other events happen on one side, as where one comes at an end of the horizon, two "
        "come at one instant, or one is touched: a derivative holds on the other side alone"
    )
    return doubts.cause("changed sequence", reason, "move the parameters off this point, or leave this motion out")


def _kink(doubts: Doubts) -> Cause:
    reason = (
        "J has a kink at this very point, with the same events on both sides of it; what the methods give is the slope "
        "of one side or lies between both, as JAX has it for `maximum`, `abs` and `where`"
    )
    remedy = "move the parameters off this point, or round the kink off in the cost, or where these parameters enter"
    return doubts.cause("kink", reason, remedy, doubts.events)


def _untested(doubts: Doubts) -> Cause:
    reason = "a piece of the motion cannot be started by itself, as where several contacts come to rest together"
    remedy = "rely on the derivatives by the parameters, which agree, or check a cost that ends before this event"
    return doubts.cause("other events", reason, remedy, doubts.events)


def _unexplained(doubts: Doubts, undecided: bool) -> Cause:
    if undecided:
        reason = "differences do not decide: J has a kink or a jump close by, or changes by little more than rounding"
        remedy = "look at J around these values; both gradient methods and the reference, where there is one, agree"
        return doubts.cause("undecided", reason, remedy, doubts.events)
    reason = "none of those that are looked for; most often a derivative that is not that of its function"
    remedy = "look for `stop_gradient`, `custom_jvp` or a kink of the cost itself, where these parameters enter"
    return doubts.cause("unexplained", reason, remedy, doubts.events)


def _those_with(doubts: Doubts, rows: Sequence[int]) -> list[EventCheck]:
    return [entry for entry in doubts.events if set(rows) & set(entry.events)]


def _labels(number: int, rows: Sequence[int]) -> str:
    return ", ".join(f"{number}:{k}" for k in rows)
