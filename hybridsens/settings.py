"""Settings of a motion, checked: tolerances, the longest step, room, the methods."""

import functools
import math
import os
from collections.abc import Iterable, Mapping
from typing import Any, TypedDict

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from .adjoint.methods import AbstractGradientMethod
from .forward.solver import RunSettings
from .status import Status
from .validation.arguments import real_array, real_fraction, real_tolerance
from .validation.asked import Asked, kind_of
from .validation.caller import warn_caller
from .validation.direction import not_differentiable
from .validation.spelling import did_you_mean


def finest_tolerance(dtype) -> float:
    """The tightest relative tolerance that a floating point type can meet: 16 eps."""
    return 16 * float(jnp.finfo(dtype).eps)


def _tolerances(rtol, atol, dtype):
    """Tolerances that the floating point type can meet.

    `atol` is a size in the units of the state, which only the caller knows. In single precision it is raised in
    proportion to `rtol`, as the two are mostly given as one number."""
    finest = finest_tolerance(dtype)
    smallest = float(jnp.finfo(dtype).tiny) ** 0.5  # the error norm squares an error over it
    if isinstance(rtol, jax.Array) or isinstance(atol, jax.Array):
        raised = _raised(rtol, finest)
        return raised, _raised(atol * (raised / rtol if dtype == jnp.float32 else 1), smallest)
    atol = max(atol, smallest)
    if rtol < finest:
        enabled = jax.dtypes.canonicalize_dtype(float) == jnp.float64
        double = " For double precision " + (
            "give the initial state in it, as by `jnp.asarray(q, float)`."
            if enabled
            else "call `hybridsens.configure()` before JAX starts."
        )
        warn_caller(
            f"An `rtol` below {finest:.1e} is beyond {dtype} and is raised to it"
            f"{f', and `atol` in proportion.{double}' if dtype == jnp.float32 else '.'}"
        )
        return finest, atol * (finest / rtol if dtype == jnp.float32 else 1)
    return rtol, atol


def _raised(tolerance, finest: float):
    """A tolerance that is known only when the motion runs; one that is not positive stays, to be refused."""
    return jnp.where(jnp.asarray(tolerance) > 0, jnp.maximum(tolerance, finest), tolerance)


class Settings(TypedDict, total=False):
    """How motions are computed. Every study takes these by name and hands them on to `simulate` or `solve`, as in
    `hs.fit(scene, data, rtol=1e-10, max_events=500)`. What is left out is as the study says, or else as these have it.
    """

    solver: diffrax.AbstractSolver | None
    """Any Diffrax solver with an error estimate."""
    rtol: float | Array
    """Relative tolerance of a step."""
    atol: float | Array
    """Absolute tolerance of a step."""
    max_events: int
    """Room for events."""
    max_steps: int
    """Room for steps tried."""
    max_step: float | Array | None
    """Longest step [s]."""
    capture_speed: float | Array | None
    """Of a mechanical scene: when a cascade of impacts ends in sustained contact."""


def chosen_settings(
    study: str,
    given: Mapping[str, Any],
    own: Mapping[str, Any],
    varied: tuple[str, ...] = (),
    arguments: Iterable[str] = (),
) -> dict:
    """The settings of a study: its own, replaced by those that are given. `arguments` are those of its own that a
    misspelt one may have meant.

    Raises: TypeError for what is no setting, and for one that the study varies by itself."""
    known = [name for name in Settings.__annotations__ if name not in varied]
    unknown = [name for name in given if name not in known]
    if unknown:
        and_arguments = f"; its own arguments are {', '.join(arguments)}" if arguments else ""
        raise TypeError(
            f"`{study}` must have settings among {', '.join(known)}{and_arguments}, but has "
            f"{', '.join(unknown)}.{did_you_mean(unknown, [*known, *arguments])}"
        )
    return {**own, **given}


def run_settings(
    asked: Mapping[str, Any], adjoint: AbstractGradientMethod, ts: Any, x0: Any, arguments: Any
) -> tuple[RunSettings, Any]:
    """What a motion from x0 is run with, all of it asked, and its capture speed. `arguments` are those of the motion.

    Raises: ValueError or TypeError for what is no count, no number or no solver, or does not go together."""
    check_counts(asked)
    leaves = jax.tree.leaves(x0)
    dtype, size = jnp.result_type(*leaves), sum(leaf.size for leaf in leaves)
    numbers = (asked["rtol"], asked["atol"], asked["max_step"], asked.get("capture_speed", 0.0))
    rtol, atol, max_step, capture_speed = given_numbers(*numbers, dtype, arguments)
    solver, max_events, max_steps = asked["solver"] or diffrax.Tsit5(), asked["max_events"], asked["max_steps"]
    segment_steps = segment_room(adjoint, ts)
    check_room(max_events, segment_steps or max_steps, size, dtype)
    run = RunSettings(solver, rtol, atol, max_events, max_steps, segment_steps, max_step, adjoint.step_rtol)
    return run, capture_speed


def given_numbers(rtol, atol, max_step, capture_speed, dtype, arguments) -> tuple[Any, Any, Any, Any]:
    """The settings that are numbers, checked, in the same order.

    Inside of a program that is being compiled, as `arguments` of the motion tell, they are constants of it, which is
    quicker. A call by itself makes arrays of them: then one compiled program serves all values."""
    rtol, atol = _tolerances(real_tolerance("rtol", rtol), real_tolerance("atol", atol), dtype)
    max_step = None if max_step is None else real_tolerance("max_step", max_step)
    numbers = (rtol, atol, max_step, real_fraction("capture_speed", capture_speed))
    arrays, known = eqx.partition(numbers, lambda x: isinstance(x, jax.Array))
    if jax.tree.leaves(arrays):
        arrays = jax.tree.map(lambda x: x.astype(dtype), not_differentiable(arrays))
    if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arguments)):
        known = jax.tree.map(lambda x: np.asarray(x, dtype), known)
    return eqx.combine(arrays, known)


def declared_jump_times(model: Any, jump_ts, dtype) -> Array | None:
    """Times at which the flow has a kink or a jump: those given, or else those that a scene or a system declares.

    Raises: TypeError or ValueError for what is no vector of numbers; a time that is no number would never come."""
    name = "jump_ts"
    if jump_ts is None:
        name, jump_ts = "jump_times", Asked.of(model, "jump_times()")()
    if jump_ts is None:
        return None
    times = real_array(name, jump_ts, 1, axis="jump")
    # Asked of NumPy: while a program is compiled, JAX's answer is traced though the times are known.
    unknown = np.zeros(0, bool) if isinstance(times, Tracer) else np.isnan(times)
    if unknown.any():
        raise ValueError(f"`{name}` must hold times, but number {int(unknown.argmax())} of them is nan.")
    return times.astype(dtype)


def horizon_status(t0, t1, ts, settings: RunSettings, capture_speed: float | Array = 0.0) -> Status:
    """Whether times and tolerances fit; what depends on the scene is looked at where the motion begins."""
    capture_speed = jnp.asarray(capture_speed)
    is_size = lambda x: (jnp.asarray(x) > 0) & (x < jnp.inf)
    fits = is_size(settings.rtol) & is_size(settings.atol) & (capture_speed >= 0) & (capture_speed < 1)
    status = Status.where(fits, Status.running, Status.bad_tolerance)
    if ts is not None and ts.shape[0] > 0:
        sorted_inside = jnp.all(ts[1:] >= ts[:-1]) & (ts[0] >= t0) & (ts[-1] <= t1)
        status = Status.where(sorted_inside, status, Status.unsorted_times)
    return Status.where((t1 > t0) & jnp.isfinite(t1 - t0), status, Status.bad_horizon)


def segment_room(adjoint: AbstractGradientMethod, ts) -> int | None:
    """Room for the steps of a segment where they are not recorded.

    Raises: ValueError where samples need recorded ones."""
    if adjoint.segment_room is not None and ts is not None:
        raise ValueError("`ts` needs recorded steps, which Replay(recompute=True) does not keep: use Replay().")
    return adjoint.segment_room


def check_solver(name: str, solver: Any) -> None:
    """Raise TypeError for what has no error estimate, or splits the flow into several terms."""
    adaptive = isinstance(solver, diffrax.AbstractAdaptiveSolver)
    if not adaptive or solver.term_structure is not diffrax.AbstractTerm:
        raise TypeError(
            f"`{name}` must be a Diffrax solver of ordinary differential equations with an error estimate, such as "
            f"diffrax.Tsit5(), Dopri8() or Kvaerno5(), which takes the flow as one term, but is {kind_of(solver)}."
        )


def check_counts(asked: Mapping[str, Any]) -> None:
    """Raise ValueError or TypeError for room that is no count, and for what is no solver."""
    for name in ("max_events", "max_steps"):
        value = asked[name]
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise ValueError(f"`{name}` must be an integer >= 1, but is {value!r}.")
    if asked["solver"] is not None:
        check_solver("solver", asked["solver"])


def check_method(adjoint: Any, throw: Any) -> None:
    """Raise TypeError for what is no gradient method, and no way to raise."""
    if adjoint is not None and not isinstance(adjoint, AbstractGradientMethod):
        raise TypeError(f"`adjoint` must be a gradient method such as hybridsens.Replay(), but is {kind_of(adjoint)}.")
    if not isinstance(throw, bool) and not (isinstance(throw, str) and throw == "nan"):
        raise TypeError(f'`throw` must be True, False or "nan", but is {throw!r}.')


def check_room(max_events: int, max_steps: int, state_size: int, dtype) -> None:
    """Raise ValueError where the records of events and steps cannot fit into the memory of the device.

    Counted is what they take at the least: (t, x) of a step, and of an event when, what, x- and x+.
    """
    size = jnp.dtype(dtype).itemsize
    steps, events = size * (state_size + 1) * max_steps, size * (2 * state_size + 2) * max_events
    memory = _memory()
    if steps + events > memory:
        raise ValueError(
            f"`max_events` and `max_steps` must leave records that fit into {memory / 1e9:.3g} GB of memory, but those "
            f"of {max_events} events take {events // 10**9} GB and those of {max_steps} steps {steps // 10**9} GB at "
            "least. Lower them, or keep no steps by adjoint=Replay(recompute=True)."
        )


@functools.cache
def _memory() -> int | float:
    """Bytes of memory that arrays can have: those of the accelerator, or all of this machine's; inf if unknown."""
    stats = jax.local_devices()[0].memory_stats() or {}
    if "bytes_limit" in stats:
        return stats["bytes_limit"]
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system can be asked
        return math.inf
