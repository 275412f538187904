"""How a motion ended. Every message says what to do."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int


class _Outcome(NamedTuple):
    """An outcome that has no code yet."""

    message: str
    at_start: bool


def outcome(message: str, at_start: bool = False) -> Any:
    """One outcome: an attribute of a class that `numbered` is given. `at_start`: a motion can only end so before it
    begins."""
    return _Outcome(message, at_start)


class Status(eqx.Module):
    """How a motion ended; `status.message`, or `Status[status]`, says what to do, and `str(status)` names it too. The
    statuses of a batch are one status with an array of codes; an array of codes, such as a sweep returns, can be
    compared with a status as well.

    Parts of the package that know more of a motion than that it has events add outcomes of their own; see `numbered`.
    """

    code: Int[Array | np.ndarray, "*batch"]
    """Place in `names()`."""

    successful = outcome("")
    running = outcome("the motion has not reached its end (this is a state inside the loop, not an outcome).")
    max_events_reached = outcome(
        "the motion had more events than `max_events`. Raise `max_events`, unless the last ones came at one instant: "
        "then each brings about the next, for ever."
    )
    max_steps_reached = outcome(
        "the motion needed more steps than `max_steps`. Raise `max_steps`, loosen `rtol` and `atol`, lengthen "
        "`max_step` if it is given, or, if the flow is stiff, use an implicit solver unless it is one already. Where "
        "the clock is late (1e9 s is known to 1e-7 s), measure time from a nearer zero."
    )
    step_size_underflow = outcome(
        "the step size fell below the resolution of time. The flow may be stiff or singular near the last time "
        "reached (one that runs away, as a neuron's spike, wants an event that ends it sooner); `rtol` and `atol` may "
        "be too tight for the floating point type."
    )
    non_finite = outcome(
        "a state, its flow, a guard or its rate, or a known time is not finite. Look at these and at the running "
        "cost, and at their derivatives, at the last time reached (that of `jnp.linalg.norm(v)` is nan at v = 0, that "
        "of `jnp.sqrt(v @ v + 1e-30)` is 0; that of `jnp.where` is nan where that of the branch that was not taken is)."
    )
    cost_not_finite = outcome(
        "the motion reached its end, but what the cost makes of it, or the gradient of that, is not finite. Look at "
        "what it reads of events that did not come, whose times are inf, and at its own functions. A gradient is nan "
        "too where its steps, shorter than those of the motion, found no room: raise `max_steps`."
    )
    grazing = outcome(
        "the motion reached its end, but touched or missed an event so narrowly that the tolerances cannot tell "
        "which. Values are right to the order of its speed; derivatives are not (at grazing they do not exist). "
        "Tighten `rtol` and `atol` (`atol` must be small beside the states, in their units), leave this parameter "
        "value out, or accept it with `throw=False`."
    )
    guard_jumps = outcome(
        "the motion reached its end, but an event came where its guard jumps below zero. Values are right; derivatives "
        "are not, since nothing tells how that place moves. Declare a time by `jump_ts`; for a place write a guard "
        "that falls there. Where no derivative is wanted, set `known_discontinuities = True`."
    )
    flow_jumps = outcome(
        "the motion reached its end, but its flow jumps where nothing tells of it, or changes within less than a step. "
        "Values are right; derivatives are not, since that of the instant of the jump is missing. Make the jump an "
        "event: by a guard, or by `located_discontinuities = True`, which locates comparisons; declare its time by "
        "`jump_ts=` where it depends on the time alone; widen what is smooth but steep, or tighten `rtol` and `atol`. "
        "Where no derivative is wanted, set `known_discontinuities = True`."
    )
    event_repeats = outcome(
        "an event happened again at the instant at which it had just happened, and would for ever. Where switches "
        "chatter, set their thresholds apart. Where a motion slides along a threshold or a comparison, as dry friction "
        "at rest does, or its events accumulate, as those of a ball that comes to rest, give the system a mode for "
        "what comes after."
    )
    scheduled_time_moves = outcome(
        "a scheduled time changes between events, so it is not known before it comes. Make it from parameters, the "
        "mode and parts of the state whose flow is 0; for a time that depends on the rest write a guard."
    )
    reset_unclear = outcome(
        "an event moved its guard up by so little that rounding may have done it, as the state was once far larger: "
        "less than 4e-11 of that size counts as rounding, in single precision 2e-5. Begin a new motion where the "
        "state has become small, measure it from a nearer zero, or compute in double precision."
    )
    queue_full = outcome("more delayed events were waiting at once than the `DelayQueue` has places. Make it larger.")
    bad_horizon = outcome(
        "the end of the horizon must be later than its start, t1 > t0, and both must be finite.", at_start=True
    )
    unsorted_times = outcome("`ts` must be sorted in increasing order and lie within [t0, t1].", at_start=True)
    bad_tolerance = outcome("`rtol` and `atol` must be positive and finite.", at_start=True)

    @staticmethod
    def names() -> tuple[str, ...]:
        """Names of all outcomes, in the order of their codes."""
        return tuple(_OUTCOMES)

    @staticmethod
    def messages() -> tuple[str, ...]:
        """What each of them means, and what to do."""
        return tuple(outcome.message for outcome in _OUTCOMES.values())

    @staticmethod
    def where(condition: Any, chosen: "Status", otherwise: "Status") -> "Status":
        """One status or the other."""
        if chosen.code is otherwise.code:
            return chosen
        with jax.ensure_compile_time_eval():
            return Status(jnp.where(condition, chosen.code, otherwise.code))

    @property
    def message(self) -> str:
        """What it means, and what to do; empty for success."""
        if isinstance(self.code, jax.core.Tracer):
            return "traced"
        if not eqx.is_array_like(self.code):  # a tree of something else, such as shapes
            return "unknown"
        return str(np.vectorize(Status.messages().__getitem__)(self.code))

    @property
    def name(self) -> str:
        """Its name (of one motion whose status can be seen)."""
        return Status.names()[int(self.code)]

    @property
    def at_start(self) -> bool:
        """Whether the motion could not begin (of one motion whose status can be seen)."""
        return _OUTCOMES[self.name].at_start

    @property
    def reached_end(self) -> Bool[Array, "*batch"]:
        """Whether the motion is whole; one whose derivatives are not to be trusted is."""
        return (self == Status.successful) | self.in_doubt

    @property
    def in_doubt(self) -> Bool[Array, "*batch"]:
        """Whether the motion is whole, and its derivatives are not to be trusted."""
        return (self == Status.grazing) | (self == Status.guard_jumps) | (self == Status.flow_jumps)

    @property
    def without_jumps(self) -> "Status":
        """The status, where jumps are known to do no harm."""
        return Status.where((self == Status.guard_jumps) | (self == Status.flow_jumps), Status.successful, self)

    def __class_getitem__(cls, status: Any) -> str:
        if isinstance(status, Status):
            return status.message
        code = _codes(status)
        if code is None or np.ndim(code) or not 0 <= code < len(_OUTCOMES):
            raise TypeError(f"Status[...] must be given a status, or the code of one, but is given {_shown(status)}.")
        return Status.messages()[int(code)]

    def __eq__(self, other: Any) -> Bool[Array, "*batch"]:  # type: ignore[override]
        codes = other.code if isinstance(other, Status) else _codes(other)
        if codes is None or isinstance(other, int):
            raise TypeError(
                "A status must be compared with a status, as `hybridsens.Status.successful`, or with an array of "
                f"integer codes, as a sweep returns, but is with {_shown(other)}."
            )
        with jax.ensure_compile_time_eval():
            return jnp.asarray(self.code == codes)

    def __ne__(self, other: Any) -> Bool[Array, "*batch"]:  # type: ignore[override]
        return ~(self == other)

    def __hash__(self) -> int:
        raise TypeError("A status cannot be in a set or a key of a dict, for its code is an array: use `status.name`.")

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        """The codes, so that NumPy, pandas and xarray compare a status with those of a sweep."""
        return np.array(self.code, dtype, copy=True if copy is None else copy)

    def __int__(self) -> int:
        """The code of one status."""
        return int(self.code)

    def __str__(self) -> str:
        """The name and, unless it says all, the message; of a batch how many have which name, "97 successful, 3
        grazing"."""
        if isinstance(self.code, jax.core.Tracer) or not eqx.is_array_like(self.code):
            return self.message
        codes, counts = np.unique(np.asarray(self.code), return_counts=True)
        names = [Status.names()[code] for code in codes]
        if np.ndim(self.code) > 0:
            often = sorted(zip(counts.tolist(), names, strict=True), key=lambda found: -found[0])
            return ", ".join(f"{count} {name}" for count, name in often)
        return f"{names[0]}: {self.message}" if self.message else names[0]

    def __repr__(self) -> str:
        return f"Status<{self}>"


def _codes(given: Any) -> Any:
    """Codes from a number or an array of integers, of whichever library; None for anything else."""
    codes = given if isinstance(given, jax.Array) else np.asarray(given)
    return codes if jnp.issubdtype(codes.dtype, jnp.integer) else None


def _shown(given: Any) -> str:
    """A text or a number itself, else what kind of thing it is."""
    return repr(given) if isinstance(given, str | int | float) else f"a {type(given).__name__}"


_OUTCOMES: dict[str, _Outcome] = {}


def numbered(cls: type) -> type:
    """Give every `outcome` of a class the next code and make it an attribute of `Status` too.

    So whatever moves shares one kind of status, and any two of them can be compared and chosen from."""
    for name, value in list(vars(cls).items()):
        if isinstance(value, _Outcome):
            status = Status(np.array(len(_OUTCOMES), np.int32))
            _OUTCOMES[name] = value
            setattr(cls, name, status)
            setattr(Status, name, status)
    return cls


def add_remark(status: Status, text: str) -> None:
    """More to the message of an outcome, from a part of the package that knows more of it."""
    name = status.name
    _OUTCOMES[name] = _OUTCOMES[name]._replace(message=f"{_OUTCOMES[name].message} {text}")


numbered(Status)
