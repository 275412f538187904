"""What a scene must be: shapes before anything runs, values at the start of the motion."""

import functools
import math
import os

import jax
import jax.numpy as jnp

from ..short import all_of
from ..status import Status
from .contact import gap_and_rate
from .dense import pivots
from .mode import ContactMode, gap_tolerance
from .returned import returned_array, returned_leaves
from .scene import AbstractScene, State


def real_array(name: str, value, ndim: int) -> jax.Array:
    """`value` as an array of real numbers with so many axes. Raises: TypeError or ValueError with its name."""
    try:
        array = jnp.asarray(float(value) if isinstance(value, int) else value)
    except (TypeError, ValueError, OverflowError) as error:
        raise TypeError(f"`{name}` must hold real numbers, but is {type(value).__name__}.") from error
    if not any(jnp.issubdtype(array.dtype, kind) for kind in (jnp.floating, jnp.integer, jnp.bool_)):
        raise TypeError(f"`{name}` must hold real numbers, but has type {array.dtype}.")
    if array.ndim != ndim:
        expected = ["()", "(sample,)"][ndim]
        raise ValueError(f"`{name}` must have shape {expected}, but has shape {array.shape}.")
    return array


def real_tolerance(name: str, value):
    """A positive number, or a scalar array whose value is looked at when the motion runs."""
    if isinstance(value, jax.Array):
        return real_array(name, value, 0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value <= 1e308:
        raise ValueError(f"`{name}` must be a positive number, but is {value!r}.")
    return float(value)


def check_shapes(scene: AbstractScene, state: State, running_cost) -> None:
    """Raise ValueError or TypeError where the scene's functions do not fit the state or each other."""
    if not isinstance(scene, AbstractScene):
        raise TypeError(f"`scene` must be a hybridsens.AbstractScene, but is {type(scene).__name__}.")
    if not isinstance(state, State):
        raise TypeError(f"`state` must be a hybridsens.State, but is {type(state).__name__}: use State(q, v).")
    q, v = state.q, state.v
    if q.ndim != 1 or q.shape != v.shape or q.shape[0] == 0:
        raise ValueError(
            f"The state must have q and v of one shape (dof,) with dof >= 1, but has q {q.shape} and v {v.shape}. "
            "For a batch of motions use jax.vmap."
        )
    dof = q.shape[0]
    t = jax.ShapeDtypeStruct((), q.dtype)
    if running_cost is not None and not callable(running_cost):
        raise TypeError(
            f"`running_cost` must be a function of (scene, t, q, v), but is {type(running_cost).__name__}."
        )
    gap = returned_array("gap", scene.gap, t, q)
    if gap.ndim != 1:
        raise ValueError(f"`gap` must return an array of shape (contact,), but returns shape {gap.shape}.")
    if gap.dtype != q.dtype:
        raise TypeError(
            f"`gap` must return {q.dtype}, the type of the state, but returns {gap.dtype}: give both one type."
        )
    _must_be("mass_matrix", returned_array("mass_matrix", scene.mass_matrix, q), (dof, dof))
    _must_be("force", returned_array("force", scene.force, t, q, v), (dof,))
    _must_be("restitution", returned_array("restitution", scene.restitution), gap.shape)
    if running_cost is not None and not returned_leaves("running_cost", running_cost, scene, t, q, v):
        raise TypeError("`running_cost` must return real numbers, but returns nothing.")


def check_room(max_events: int, max_steps: int, state: State) -> None:
    """Raise ValueError where the records of events and steps cannot fit into the memory of the device.

    Counted is what they take at the least: (t, x) of a step, and of an event when, what, x- and x+.
    """
    size, dof = state.q.dtype.itemsize, state.q.shape[0]
    steps, events = size * (2 * dof + 1) * max_steps, size * (4 * dof + 5) * max_events
    memory = _memory()
    if steps + events > memory:
        raise ValueError(
            f"`max_events` and `max_steps` must leave records that fit into {memory / 1e9:.3g} GB of memory, but those "
            f"of {max_events} events take {events // 10**9} GB and those of {max_steps} steps {steps // 10**9} GB at "
            "least. Lower them, or keep no steps by adjoint=Replay(recompute=True)."
        )


def may_begin(scene: AbstractScene, mode: ContactMode, event, t, q, v) -> Status:
    """`Status.running` where the values at (t, q, v) fit, or why the motion must not go on from there.

    Asked at the start (`event` -1), and again at every event, where the gaps are the business of the laws.
    """
    mass_matrix = scene.mass_matrix(q)
    gap, rate = gap_and_rate(scene, t, q, v)
    e = scene.restitution()
    size = jnp.max(jnp.abs(mass_matrix))
    symmetric = jnp.max(jnp.abs(mass_matrix - mass_matrix.T)) <= 1e3 * jnp.finfo(q.dtype).eps * size
    values = jnp.concatenate([q, v, jnp.ravel(mass_matrix), gap, rate, scene.force(t, q, v), t[None]])
    requirements = (
        (Status.penetration, (event >= 0) | all_of(gap >= -gap_tolerance(mode.length))),
        (Status.bad_restitution, all_of((e >= 0) & (e <= 1))),
        (Status.bad_mass_matrix, symmetric & all_of(pivots(mass_matrix) > 0)),
        (Status.non_finite, all_of(jnp.isfinite(values))),
    )
    status = Status.running
    for failure, fits in requirements:
        status = Status.where(fits, status, failure)
    return status


def _must_be(name: str, returned: jax.ShapeDtypeStruct, expected) -> None:
    if returned.shape != expected:
        raise ValueError(f"`{name}` must return an array of shape {expected}, but returns shape {returned.shape}.")


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
