"""What a scene must be: shapes before anything runs, values at the start of the motion."""

import functools
import math
import os

import jax
import jax.numpy as jnp
import lineax as lx
from jax import lax

from ..numerics.small_arrays import all_of
from ..status import Status
from ..validation.returned import returned_array, returned_leaves
from .contact import gap_and_rate
from .mass import ConstantMass, is_positive_definite, mass_entries
from .mode import ContactMode, gap_tolerance
from .scene import AbstractScene, State
from .status import ContactStatus
from .typed import as_written


def check_shapes(scene: AbstractScene, state: State, running_cost) -> bool:
    """Raise ValueError or TypeError where the scene's functions do not fit the state or each other.

    Returns: whether all of them return the type of the state."""
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
        raise TypeError(f"`running_cost` must be a function of (scene, t, q, v), but is {type(running_cost).__name__}.")
    gap = returned_array("gap", scene.gap, t, q)
    if gap.ndim != 1:
        raise ValueError(f"`gap` must return an array of shape (contact,), but returns shape {gap.shape}.")
    if jnp.finfo(gap.dtype).bits < jnp.finfo(q.dtype).bits:  # its rounding is what events are told by
        raise TypeError(
            f"`gap` must return {q.dtype}, the type of the state, but returns {gap.dtype}, which is coarser: give both "
            "one type."
        )
    returned = [
        _must_be("mass_matrix", returned_mass(scene, q), (dof, dof)),
        _must_be("force", returned_array("force", scene.force, t, q, v), (dof,)),
        _must_be("restitution", returned_array("restitution", scene.restitution), gap.shape),
    ]
    if running_cost is not None and not returned_leaves("running_cost", running_cost, as_written(scene), t, q, v):
        raise TypeError("`running_cost` must return real numbers, but returns nothing.")
    return all(function.dtype == q.dtype for function in [gap, *returned])


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
    mass = scene.mass_matrix(q)
    gap, rate = gap_and_rate(scene, t, q, v)
    e = scene.restitution()
    entries = [jnp.ravel(part) for part in jax.tree.leaves(mass_entries(mass))]
    values = jnp.concatenate([q, v, *entries, gap, rate, scene.force(t, q, v), t[None]])
    requirements = (
        (ContactStatus.penetration, (event != -1) | all_of(gap >= -gap_tolerance(mode.length))),
        (ContactStatus.bad_restitution, all_of((e >= 0) & (e <= 1))),
        (ContactStatus.bad_mass_matrix, _definite(mass, event)),
        (Status.non_finite, all_of(jnp.isfinite(values))),
    )
    status = Status.running
    for failure, fits in requirements:
        status = Status.where(fits, status, failure)
    return status


def returned_mass(scene: AbstractScene, q) -> jax.ShapeDtypeStruct:
    """Shape and type of the mass matrix: an array, or a linear operator from coordinates to coordinates.

    Raises: TypeError or ValueError where it is neither, or where an operator does not fit itself."""

    def as_array(q):
        mass = scene.mass_matrix(q)
        if not isinstance(mass, lx.AbstractLinearOperator):
            return mass
        sizes = mass.out_size(), mass.in_size()
        if mass.in_structure() != mass.out_structure() or len(jax.tree.leaves(mass.in_structure())) != 1:
            raise ValueError(
                "`mass_matrix` must return an array or a lineax operator of one vector (dof,) to another, but the "
                f"operator maps {mass.in_structure()} to {mass.out_structure()}."
            )
        parts = jax.tree.leaves(mass_entries(mass))
        return jnp.zeros(sizes, parts[0].dtype if parts else q.dtype)

    return returned_array("mass_matrix", as_array, q)


def _definite(mass, event):
    """Whether the mass matrix is positive definite; of one that never changes it is asked once."""
    if not isinstance(mass, ConstantMass):
        return is_positive_definite(mass)
    return lax.cond(event < 0, lambda: is_positive_definite(mass), lambda: jnp.array(True))


def _must_be(name: str, returned: jax.ShapeDtypeStruct, expected) -> jax.ShapeDtypeStruct:
    if returned.shape != expected:
        raise ValueError(f"`{name}` must return an array of shape {expected}, but returns shape {returned.shape}.")
    return returned


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
