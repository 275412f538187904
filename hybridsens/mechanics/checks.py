"""What a scene must be: shapes before anything runs, values at the start of the motion."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..short import all_of
from ..status import Status
from .dense import pivots
from .mode import ContactMode, gap_tolerance
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
    contacts = _shape(scene.gap, t, q)
    if len(contacts) != 1:
        raise ValueError(f"`gap` must return an array of shape (contact,), but returns shape {contacts}.")
    kind = eqx.filter_eval_shape(scene.gap, t, q).dtype
    if kind != q.dtype:
        raise TypeError(f"`gap` must return {q.dtype}, the type of the state, but returns {kind}: give both one type.")
    _must_be("mass_matrix", _shape(scene.mass_matrix, q), (dof, dof))
    _must_be("force", _shape(scene.force, t, q, v), (dof,))
    _must_be("restitution", _shape(scene.restitution), contacts)
    if running_cost is not None:
        costs = jax.tree.leaves(eqx.filter_eval_shape(running_cost, scene, t, q, v))
        if not costs:
            raise TypeError("`running_cost` must return real numbers, but returns nothing.")
        for leaf in costs:
            kind = getattr(leaf, "dtype", type(leaf))
            if not jnp.issubdtype(kind, jnp.floating):
                raise TypeError(f"`running_cost` must return real numbers, but returns {kind}.")


def may_begin(scene: AbstractScene, mode: ContactMode, event, t, q, v) -> Status:
    """`Status.running` where the values at (t, q, v) fit, or why the motion must not go on from there.

    Asked at the start (`event` -1), and again at every event, where the gaps are the business of the laws.
    """
    mass_matrix = scene.mass_matrix(q)
    gap = scene.gap(t, q)
    e = scene.restitution()
    size = jnp.max(jnp.abs(mass_matrix))
    symmetric = jnp.max(jnp.abs(mass_matrix - mass_matrix.T)) <= 1e3 * jnp.finfo(q.dtype).eps * size
    values = jnp.concatenate([q, v, jnp.ravel(mass_matrix), gap, scene.force(t, q, v), t[None]])
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


def _shape(function, *arguments) -> tuple[int, ...]:
    out = eqx.filter_eval_shape(function, *arguments)
    name = getattr(function, "__name__", "a scene's function")
    if not hasattr(out, "shape"):
        raise TypeError(f"`{name}` must return an array, but returns {type(out).__name__}.")
    if not jnp.issubdtype(out.dtype, jnp.floating):
        raise TypeError(f"`{name}` must return real numbers, but returns {out.dtype}.")
    return tuple(out.shape)


def _must_be(name: str, shape, expected) -> None:
    if tuple(shape) != tuple(expected):
        raise ValueError(f"`{name}` must return an array of shape {tuple(expected)}, but returns shape {tuple(shape)}.")
