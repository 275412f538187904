"""What a scene must be: shapes before anything runs, values at the start of the motion."""

from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
from jax import lax

from ..export.names import contact_names, coordinate_names
from ..flat_system import START
from ..numerics.tolerances import MOST_RELAXED, time_resolution
from ..status import Status
from ..validation.asked import Asked, is_method, kind_of
from ..validation.returned import must_have_shape, returned_array, returned_leaves
from .contact import Instant, gap_and_rate
from .mass import ConstantMass, is_positive_definite, mass_entries
from .mode import ContactMode
from .scene import AbstractScene, State
from .status import ContactStatus
from .wrapped import as_written

_FOR_EACH_GAP = " It must have an entry for each gap."


def check_kinds(scene: Any, state: Any) -> None:
    """Raise TypeError unless there are a scene and a state, in this order."""
    if isinstance(scene, State) and isinstance(state, AbstractScene):
        raise TypeError(
            "`scene` must come first and `state` second, but they stand the other way round: write "
            "simulate(scene, state, t1=...)."
        )
    if not isinstance(scene, AbstractScene):
        elsewhere = ", a hybrid system: use hybridsens.solve" if hasattr(scene, "transition") else ""
        raise TypeError(f"`scene` must be a hybridsens.AbstractScene, but is {kind_of(scene)}{elsewhere}.")
    if not isinstance(state, State):
        remedy = "." if isinstance(state, type) or is_method(state) else ": use State(q, v)."
        raise TypeError(f"`state` must be a hybridsens.State, but is {kind_of(state)}{remedy}")


def check_shapes(scene: AbstractScene, state: State, running_cost) -> bool:
    """Raise ValueError or TypeError where the scene's functions do not fit the state or each other.

    Returns: whether all of them return the type of the state."""
    q, v = state.q, state.v
    if q.ndim != 1 or q.shape != v.shape or q.shape[0] == 0:
        raise ValueError(
            f"The state must have q and v of one shape (dof,) with dof >= 1, but has q {q.shape} and v {v.shape}. "
            "For a batch of motions use jax.vmap."
        )
    t, owner = jax.ShapeDtypeStruct((), q.dtype), type(as_written(scene))
    asked = lambda form: Asked(form, getattr(scene, form.partition("(")[0]), owner)
    gap = must_have_shape(asked("gap(t, q)"), returned_array(asked("gap(t, q)"), t, q), ("contact",))
    coordinate_names(as_written(scene), q.shape[0])  # names that do not fit are refused before the motion, not after it
    contact_names(as_written(scene), gap.shape[0])
    if jnp.finfo(gap.dtype).bits < jnp.finfo(q.dtype).bits:  # its rounding is what events are told by
        raise TypeError(
            f"`gap` must return {q.dtype}, the type of the state, but returns {gap.dtype}, which is coarser: give both "
            "one type."
        )
    returned = [
        _of_coordinates(asked("mass_matrix(q)"), returned_mass(asked("mass_matrix(q)"), q), (q, q)),
        _of_coordinates(asked("force(t, q, v)"), returned_array(asked("force(t, q, v)"), t, q, v), (q,)),
        must_have_shape(asked("restitution()"), returned_array(asked("restitution()")), gap.shape, _FOR_EACH_GAP),
    ]
    if running_cost is not None:
        returned_leaves(Asked("running_cost(scene, t, q, v)", running_cost), as_written(scene), t, q, v)
    return all(function.dtype == q.dtype for function in [gap, *returned])


def may_begin(scene: AbstractScene, mode: ContactMode, event, now: Instant) -> Status:
    """`Status.running` where the values at (t, q, v) fit, or why the motion must not go on from there.

    Asked at the start, and again at every event, where the gaps are the business of the laws.
    """
    t, q, v = now
    mass = scene.mass_matrix(q)
    gap, rate = gap_and_rate(scene, t, q, v)
    e = scene.restitution()
    entries = [jnp.ravel(part) for part in jax.tree.leaves(mass_entries(mass))]
    values = jnp.concatenate([q, v, *entries, gap, rate, scene.force(t, q, v), t[None]])
    # A motion may have ended a little inside, where it struck: its state begins another one.
    inside = mode.gap_tolerance(t) + time_resolution(t, MOST_RELAXED) * jnp.abs(rate)
    requirements = (
        (ContactStatus.penetration, (event != START) | jnp.all(gap >= -inside)),
        (ContactStatus.bad_restitution, jnp.all((e >= 0) & (e <= 1))),
        (ContactStatus.bad_mass_matrix, _definite(mass, event)),
        (Status.non_finite, jnp.all(jnp.isfinite(values))),
    )
    status = Status.running
    for failure, fits in requirements:
        status = Status.where(fits, status, failure)
    return status


def may_end(scene: AbstractScene, q, status: Status) -> Status:
    """The status of a motion that ends at q: the mass matrix may have been right by chance where it began, as at
    q = 0."""
    mass = scene.mass_matrix(q)
    if isinstance(mass, ConstantMass):
        return status
    fits = ~status.reached_end | is_positive_definite(mass)
    return Status.where(fits, status, ContactStatus.bad_mass_matrix)


def returned_mass(asked: Asked, q) -> jax.ShapeDtypeStruct:
    """Shape and type of the mass matrix: an array, or a linear operator from coordinates to coordinates.

    Raises: TypeError or ValueError where it is neither, or where an operator does not fit itself."""

    def as_array(q):
        mass = asked(q)
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

    return returned_array(asked._replace(function=as_array), q)


def _definite(mass, event):
    """Whether the mass matrix is positive definite; of one that never changes it is asked once."""
    if not isinstance(mass, ConstantMass):
        return is_positive_definite(mass)
    return lax.cond(event < 0, lambda: is_positive_definite(mass), lambda: jnp.array(True))


def _of_coordinates(asked: Asked, returned: jax.ShapeDtypeStruct, axes: tuple) -> jax.ShapeDtypeStruct:
    """What is returned, with an axis for each time that q is named. Raises: ValueError where it has other ones."""
    dof = axes[0].shape[0]
    why = f" The state has dof = {dof}: where the scene has another number of coordinates, the state is wrong."
    return must_have_shape(asked, returned, tuple(dof for _ in axes), why if returned.ndim == len(axes) else "")
