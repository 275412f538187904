"""How much work a motion took; and what becomes of one that did not reach its end: it is raised, or made nan."""

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any, NamedTuple, TypeVar, cast

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental.buffer_callback import buffer_callback
from jaxtyping import Array, Int

from .numerics.sample_times import time_in_the_way
from .status import Status


class Steps(NamedTuple):
    """How much work the motion took."""

    accepted: Int[Array, "*batch"]
    """Steps that make up the motion."""
    rejected: Int[Array, "*batch"]
    """Steps tried and not kept, for their error or because they overshot an event."""


class SimulationError(RuntimeError):
    """A motion that did not reach its end, with `throw=True`."""


def raise_unless_times_fit(t0: Any, t1: Any, ts: Any) -> None:
    """Raise SimulationError for times of which no motion can be, where they can be seen: before it is compiled."""
    if any(isinstance(leaf, jax.core.Tracer) for leaf in (t0, t1, ts)):
        return
    t0, t1, ts = np.asarray(t0), np.asarray(t1), np.zeros(0) if ts is None else np.asarray(ts)
    # What `horizon_status` asks of traced times, by NumPy: JAX would take longer than a short motion.
    if not 0 < t1 - t0 < np.inf:
        raise SimulationError(f"{_message(Status.bad_horizon.code)} Here t0 is {t0:.9g} and t1 is {t1:.9g}.")
    if not (np.all(ts[1:] >= ts[:-1]) and np.all((ts >= t0) & (ts <= t1))):
        raise SimulationError(f"{_message(Status.unsorted_times.code)} {time_in_the_way(ts, t0, t1)}")


_not_raised: ContextVar[list[bool] | None] = ContextVar("not_raised", default=None)


@contextlib.contextmanager
def noting_motions_not_raised() -> Iterator[list[bool]]:
    """What is given has an entry for each motion with `throw=False` that is computed, or traced, inside."""
    token = _not_raised.set(noted := [])
    try:
        yield noted
    finally:
        _not_raised.reset(token)


Motion = TypeVar("Motion", bound=eqx.Module)
"""What a motion left: a PyTree of arrays with a `status`."""


def answered(motion: Motion, throw: bool | str, given: Any, describe: Callable[[Any], str]) -> Motion:
    """A motion as its caller wants it where it failed: raised, made nan ("nan"), or as it is, which is noted."""
    if throw == "nan":
        return nan_unless_reached(motion, given)
    if throw:
        return raise_unless_successful(motion, describe)
    noted = _not_raised.get()
    if noted is not None:
        noted.append(True)
    return motion


def raise_unless_successful(trajectory: Motion, describe: Callable[[Any], str] = lambda _: "") -> Motion:
    """The trajectory; of a batch, the status that comes last in `Status` is raised.

    `describe` adds what the values show, where they can be seen.

    Raises: SimulationError where the outcome can be seen, also in `jax.grad` and `jax.vmap`; under `jax.jit`, where
    only the compiled program sees it, JAX makes a JaxRuntimeError of it (a ValueError where the program ran on in the
    background and is waited for).
    """

    def more():
        motion = seen(trajectory)
        return end_told(motion) + _steps_told(motion) + describe(motion)

    return raised_unless_zero(trajectory, cast(Any, trajectory).status.code, _message, more)


Tree = TypeVar("Tree")


def seen(tree: Tree) -> Tree:
    """The tree without tangents: while a derivative is taken, its numbers can be seen, unless it is compiled too."""

    def primal(leaf):
        if not isinstance(leaf, jax.core.Tracer):
            return leaf
        return lax.stop_gradient(leaf) if eqx.is_inexact_array(leaf) else _without_tangent(leaf)

    return jax.tree.map(primal, tree)


def raised_unless_zero(
    tree: Tree, code: Any, message: Callable[[Any], str], more: Callable[[], str] = lambda: ""
) -> Tree:
    """The tree, unless the code is not 0: then SimulationError, by the message of that code, and `more` where it can be
    seen. Of a batch the largest code counts."""
    worst = _worst(jnp.asarray(_without_tangent(code)))
    if isinstance(worst, jax.core.Tracer):
        one = _one_or_raise(worst, message)  # a factor, so that what a gradient comes from has been checked too
        return jax.tree.map(lambda leaf: _times(leaf, one) if eqx.is_array(leaf) else leaf, tree)
    if worst != 0:
        raise SimulationError(message(worst) + more())
    return tree


def nan_unless_reached(trajectory: Motion, given: Any) -> Motion:
    """The trajectory, with all that is real in it made nan where the motion did not reach its end, and its derivatives
    by all that is given too."""
    status = jax.tree.map(_without_tangent, cast(Any, trajectory).status)
    nan = jnp.where(status.reached_end, 0, jnp.nan)
    spoil = sum(_spoil(nan.astype(leaf.dtype), leaf) for leaf in jax.tree.leaves(given) if eqx.is_inexact_array(leaf))
    spoilt = lambda leaf: (1 + nan).astype(leaf.dtype) * leaf + spoil
    return jax.tree.map(lambda leaf: spoilt(leaf) if eqx.is_inexact_array(leaf) else leaf, trajectory)


@jax.custom_jvp
def _spoil(nan, leaf):
    """0 or nan, and so is its derivative by the leaf."""
    del leaf
    return nan


@_spoil.defjvp
def _spoil_jvp(primals, tangents):
    nan, _ = primals
    # A cotangent may be nan in rows that are blank, and must not reach the parameters of a motion that is whole.
    return nan, jnp.where(jnp.isnan(nan), nan * jnp.sum(tangents[1]), 0)


def _message(code) -> str:
    status = Status(np.asarray(code))
    ended = "is whole, but in doubt" if status.reached_end else "did not reach its end"
    became = "could not begin" if status.at_start else ended
    return f"The motion {became} ({status.name}): {status.message}"


def end_told(motion: Any) -> str:
    """When one motion that can be seen broke off, came into doubt, or ended with an event; "" of another."""
    ended, status = motion.end_time, motion.status
    if isinstance(ended, jax.core.Tracer) or np.ndim(ended) > 0 or status.at_start:
        return ""
    if not status.reached_end:  # where all is made nan, that is not known
        return "" if np.isnan(ended) else f" It broke off at t = {float(ended):.9g}."
    doubt = f" That was at t = {float(motion.doubt_time):.9g}." if status.in_doubt else ""
    last = int(motion.events.count) - 1
    if last < 0 or ended != motion.events.time[last]:
        return doubt
    by_event = f"ended with event {last}, at t = {float(ended):.9g}"
    return f"{doubt} It {by_event}." if status.in_doubt else f"; {by_event}"


def last_time(motion: Any, t1: Array | float) -> Array:
    """Up to when a motion can be asked for: t1, or when it ended with an event; beyond where it broke off it is nan."""
    return jnp.where(motion.status.reached_end, motion.end_time, t1)


def _steps_told(motion: Any) -> str:
    """How many of the steps were kept, of one motion that tried too many and can be seen: where there are few, the
    steps were too short for its errors or its events, and no room for more of them would help."""
    if any(isinstance(n, jax.core.Tracer) for n in motion.steps) or motion.status != Status.max_steps_reached:
        return ""
    return f" Of {sum(map(int, motion.steps))} steps tried {int(motion.steps.accepted)} were kept."


@jax.custom_batching.custom_vmap
def _worst(code):
    """The largest of a batch of codes: that of success is 0."""
    return code


@_worst.def_vmap
def _worst_of_batch(size, batched, codes):
    del size, batched
    return _worst(jnp.max(codes, initial=0)), False  # an empty batch has not failed


def _one_or_raise(code, message):
    """1, by a branch that raises if the code is not 0: nothing that hangs on it is computed before."""
    one = jnp.ones((), jnp.int32)
    return lax.cond(code == 0, lambda: one, lambda: _raise_from_program(code, message))


def _times(leaf, one):
    return leaf & (one == 1) if leaf.dtype == bool else leaf * one.astype(leaf.dtype)


def _raise_from_program(code, message):
    """Raise where a compiled program runs. On a CPU by that of JAX's ways that does not log what is raised."""
    one = jax.ShapeDtypeStruct((), jnp.int32)
    if jax.default_backend() == "cpu":
        return buffer_callback(lambda _, out, code: _raise(message(np.asarray(code))), one)(code)
    return jax.pure_callback(lambda code: _raise(message(code)), one, code)


def _raise(message: str):
    """Raise from inside of a generator. XLA writes the calls that led to an error before its text, from the innermost
    one outward; those that led to a generator are not known to it, so the text follows at once."""
    next(_raising(message))


def _raising(message: str):
    raise SimulationError(message)
    yield


@jax.custom_jvp
def _without_tangent(number):
    """An integer that a check may look at in the middle of differentiation (checks have no rule for its empty
    tangent)."""
    return number


@_without_tangent.defjvp
def _without_tangent_jvp(primals, tangents):
    del tangents
    return primals[0], np.zeros(jnp.shape(primals[0]), jax.dtypes.float0)
