"""Segments of no length: between two events at one instant, or before one at t0, or after one at t1.

They take no step and change no tangent and no costate. Where these are differentiated once more, the ends of the
segment move apart: the derivative of (t1 - t0) w is (dt1 - dt0) w, also where t1 = t0.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..flat_system import AbstractFlatSystem, Mode
from ..forward.record import Motion, segment, segment_end, segment_start
from ..numerics.batch_axes import batch_in_front
from ..observables import filled


@eqx.filter_custom_jvp
def _in_no_time(rate: Callable[..., Any], t0, t1, *arguments) -> Any:
    """(t1 - t0) rate(*arguments) for t1 = t0: zeros, for which nothing is computed unless they are differentiated."""
    shapes = eqx.filter_eval_shape(rate, *arguments)
    zero = _zero((t0, t1, arguments))
    return batch_in_front(jax.tree.map(lambda s: jnp.full(s.shape, zero.astype(s.dtype)), shapes))


def _zero(arguments: Any) -> Array:
    """0, made of everything: under `jax.vmap` it has an axis wherever the derivative has one, as JAX asks of it. The
    compiler sees that it is 0."""
    leaves = [leaf for leaf in jax.tree.leaves(arguments) if eqx.is_inexact_array(leaf) and leaf.size > 0]
    is_number = jnp.stack([jnp.isfinite(leaf[(0,) * leaf.ndim]) for leaf in leaves])
    return jnp.any(is_number & False)


@_in_no_time.def_jvp
def _in_no_time_jvp(primals, tangents):
    rate, t0, t1, *arguments = primals
    _, dt0, dt1, *_ = tangents
    apart = (0 if dt1 is None else dt1) - (0 if dt0 is None else dt0)
    zero = _zero((t0, t1, arguments))
    rates = jax.tree.map(lambda leaf: leaf + zero.astype(leaf.dtype), rate(*arguments))
    moved = jax.tree.map(lambda leaf: (apart * leaf).astype(leaf.dtype), rates)
    return batch_in_front((jax.tree.map(jnp.zeros_like, rates), moved))


def without_length(motion: Motion, j, t0) -> tuple[Bool[Array, ""], tuple[Array, Array], Array, Mode]:
    """Whether segment j has no length; where it begins and ends, its state, and its mode."""
    mode, first, last = segment(motion, j)
    ends = segment_start(motion, j, t0), segment_end(motion, j)
    place = jnp.minimum(j, motion.events.steps.shape[0] - 1)
    x = jnp.where(j < motion.events.count, motion.events.states.before[place], motion.x)
    return first == last, ends, x, mode


def push_no_length(system: AbstractFlatSystem, d_system, motion: Motion, j, t0, dx):
    """What a segment of no length adds to a tangent: (t1 - t0) (f_x dx + f_theta dtheta)."""
    is_empty, (start, end), x, mode = without_length(motion, j, t0)

    def rate(system, d_system, t, x, mode, dx):
        flow = lambda system, x: system.flow(t, x, mode)
        return filled(*eqx.filter_jvp(flow, (system, x), (d_system, dx)))

    return jnp.where(is_empty, _in_no_time(rate, start, end, system, d_system, end, x, mode, dx), 0)


def pull_no_length(system: AbstractFlatSystem, step_parameter_mask, motion: Motion, j, t0, psi) -> tuple[Any, Array]:
    """What a segment of no length adds to dJ/dtheta and to a costate: (t1 - t0) f_theta^T psi and (t1 - t0) f_x^T psi.
    """
    is_empty, (start, end), x, mode = without_length(motion, j, t0)

    def rate(system, t, x, mode, psi):
        parameters, static = eqx.partition(system, step_parameter_mask)
        flow = lambda parameters, x: eqx.combine(parameters, static).flow(t, x, mode)
        return jax.vjp(flow, parameters, x)[1](psi)

    added = _in_no_time(rate, start, end, system, end, x, mode, psi)
    return jax.tree.map(lambda leaf: jnp.where(is_empty, leaf, 0).astype(leaf.dtype), added)
